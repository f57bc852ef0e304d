//! Unscattered light on the GPU against that on the CPU.

use super::super::adapter;
use super::*;
use crate::backend::Device;
use crate::backend::gpu::device::for_tests;
use crate::backend::run::{illuminations, light_grids, run};
use crate::backend::single::{Single, single};
use crate::physics::Phase;
use crate::plan::{Column, Direct, Emission, Settings};
use crate::scene::field::Occupancy;
use crate::scene::light::Light;
use crate::scene::{Albedo, Camera, Medium, Scene, Spectrum, Volume};

#[derive(Debug, Clone, Copy)]
enum Density {
    One,
    Voxels,
    Linear,
}

/// A scene, and how its lights are found.
#[derive(Debug, Clone)]
struct Case {
    density: Density,
    extinction: &'static [f64],
    per_voxel: bool,
    rule: (usize, bool),
    column: Column,
    lights: Vec<Light>,
}

const N: [usize; 3] = [7, 5, 6];

/// What `f` makes of a case.
fn with<T>(case: &Case, f: impl FnOnce(&Plan, &[Option<Illumination>]) -> T) -> T {
    let hash = |i: usize| ((i * 7919 + 31) % 101) as f32 / 100.0;
    let voxels = N.iter().product();
    let density: Vec<f32> = match case.density {
        Density::One => vec![0.7; voxels],
        _ => (0..voxels).map(|i| (hash(i) - 0.3).max(0.0)).collect(),
    };
    let linear = matches!(case.density, Density::Linear);
    let albedos: Vec<f32> = (0..voxels).map(|i| hash(5 * i + 2)).collect();
    let spectrum = |v: &[f64]| Spectrum::new(v, "value").expect("valid");
    let volume = Volume::new(&density, N, [0.5, 1.0, 0.8], [-1.0, 2.0, 0.0], linear).expect("valid");
    let albedo = if case.per_voxel { Albedo::PerVoxel(&albedos) } else { Albedo::Constant(spectrum(&[0.9, 0.5, 0.1])) };
    let phase = Phase::HenyeyGreenstein { g: 0.6 };
    let medium = Medium::new(volume, spectrum(case.extinction), albedo, phase).expect("valid");
    let camera = Camera::perspective([30.0, -30.0, 20.0], [2.0; 3], [0.0, 0.0, 1.0], 20.0, [9, 9]).expect("valid");
    let scene = Scene::new(medium, case.lights.clone(), camera);
    let settings = Settings { photons: Some(1000), ..Settings::default() };
    let mut plan = Plan::new(&scene, &settings).expect("valid");
    for light in &mut plan.lights {
        light.direct = Direct::Quadrature { points: case.rule.0, rays: case.rule.1 };
        light.emission = Emission::Nothing;
        light.column = case.column;
    }
    let occupancy = Occupancy::new(&scene.medium.volume);
    let columns = light_grids(&plan, occupancy.as_ref(), &Control::new(None));
    let views = illuminations(&scene, occupancy.as_ref(), plan.lights.iter().map(|l| l.column), &columns);
    f(&plan, &views)
}

/// The voxels' light on both devices.
fn both(case: &Case) -> [Single; 2] {
    let gpu = Gpu::open("").expect("an adapter");
    let control = Control::new(None);
    let on = |device| with(case, |plan, views| single(plan, views, &device, &control).expect("it runs"));
    [on(Device::Cpu), on(Device::Gpu(gpu))]
}

/// The largest difference of two lists, relative to the values and a ten thousandth of the largest.
fn difference<T: Into<f64> + Copy>(found: &[T], truth: &[T]) -> f64 {
    assert!(found.len() == truth.len() && !found.is_empty());
    let top = truth.iter().fold(0.0, |top: f64, &t| top.max(t.into()));
    assert!(top > 0.0);
    let pairs = found.iter().zip(truth).map(|(&f, &t)| (f.into(), t.into()));
    pairs.fold(0.0, |worst: f64, (f, t)| worst.max((f - t).abs() / (t + 1e-4 * top)))
}

/// Lights inside the box, close to it, far away, and parallel.
fn lights() -> Vec<Vec<Light>> {
    let point = |p: [f64; 3], v: &[f64]| Light::point(p, v).expect("valid");
    let sun = |v: &[f64]| Light::directional([0.3, -0.5, -1.0], v).expect("valid");
    vec![
        vec![point([1.3, 4.6, 3.1], &[2.0])],
        vec![point([-1.7, 4.1, 2.2], &[2.0])],
        vec![point([-9.0, 14.0, 20.0], &[200.0])],
        vec![sun(&[3.0])],
        vec![Light::directional([0.0, 0.0, 1.0], &[3.0]).expect("valid")],
        vec![point([0.0, 5.0, 2.0], &[2.0, 1.0, 0.5]), sun(&[0.1, 0.5, 2.0]), point([9.0, 9.0, 9.0], &[3.0])],
    ]
}

#[test]
fn unscattered_light_is_that_of_the_cpu() {
    if for_tests().is_none() {
        return;
    }
    for lights in lights() {
        for density in [Density::One, Density::Voxels, Density::Linear] {
            for (extinction, rule) in [
                (&[0.3] as &[f64], (1, false)),
                (&[0.3], (4, false)),
                (&[1.5], (2, true)),
                (&[1.5, 0.3, 3.0], (3, true)),
                (&[5.0, 15.0, 0.0], (8, true)),
                (&[25.0], (16, true)),
            ] {
                // The light grid matters where not every point has a ray.
                for column in [Column::Grid, Column::Rays].into_iter().skip(usize::from(rule.1)) {
                    let per_voxel = rule.0 % 2 == 0;
                    let lights = lights.clone();
                    let case = Case { density, extinction, per_voxel, rule, column, lights };
                    let [truth, found] = both(&case);
                    let sums = |single: &Single| {
                        let all = single.collided.as_flattened().as_flattened().to_vec();
                        all.into_iter().filter(|&sum| sum > 0.0).collect::<Vec<f64>>()
                    };
                    let worst = [
                        difference(&found.fluence, &truth.fluence),
                        difference(&found.source, &truth.source),
                        difference(&sums(&found), &sums(&truth)),
                    ];
                    assert!(worst[0] < 5e-6 && worst[1] < 5e-6 && worst[2] < 3e-7, "{worst:?} {case:?}");
                }
            }
        }
    }
}

#[test]
fn the_energy_balance_is_that_of_the_cpu() {
    let Some(gpu) = for_tests() else { return };
    for density in [Density::One, Density::Voxels, Density::Linear] {
        let case = Case {
            density,
            extinction: &[1.5, 0.3, 3.0],
            per_voxel: true,
            rule: (3, true),
            column: Column::Rays,
            lights: lights().remove(5),
        };
        let energies = [Device::Cpu, Device::Gpu(gpu.clone())].map(|device| {
            let settings = Settings { max_scatterings: Some(0), ..Settings::default() };
            with(&case, |plan, _| {
                let plan = Plan::new(plan.scene, &settings).expect("valid");
                assert!(!plan.shoots());
                run(&plan, &device, &Control::new(None), None).expect("it runs").0.energy
            })
        });
        let [truth, found] = energies;
        for (found, truth) in found.fractions.as_flattened().iter().zip(truth.fractions.as_flattened()) {
            assert!((found - truth).abs() < 3e-7, "{density:?}: {found} and {truth}");
        }
        assert!(found.fractions.as_flattened().iter().sum::<f64>() > 1.0);
    }
}

#[test]
fn cutting_the_work_changes_nothing() {
    let Some(gpu) = for_tests() else { return };
    let lights = lights().remove(5);
    let case = Case {
        density: Density::Voxels,
        extinction: &[25.0, 3.0, 9.0],
        per_voxel: true,
        rule: (16, true),
        column: Column::Grid,
        lights,
    };
    let all = |limits: [usize; 2]| {
        with(&case, |plan, views| {
            let lit = |light: usize| {
                let view = views[light].as_ref().expect("a point or directional light");
                Lit { light, view, points: [16, 4, 8][light], rays: light != 1 }
            };
            let lit = [lit(0), lit(1), lit(2)];
            let control = Control::new(None);
            let mut found = Quadratures::cut(&gpu, plan, &lit, true, limits, &control).expect("it fits");
            let mut bits = Vec::new();
            while let Some(rows) = found.next_rows(&control).expect("it runs") {
                for (row, i) in rows.flat_map(|row| (0..N[0]).map(move |i| (row, i))) {
                    for at in 0..3 {
                        let Quadrature { fluence, collisions } = found.of(at, [i, row % N[1], row / N[1]]);
                        bits.extend([fluence, collisions].as_flattened().iter().map(|v| v.to_bits()));
                    }
                }
            }
            bits
        })
    };
    let truth = all([VOXELS, CELLS]);
    assert_eq!(truth.len(), N.iter().product::<usize>() * 18);
    for limits in [[1, 1 << 20], [3 * N[0], 70_000], [64, CELLS]] {
        assert!(all(limits) == truth, "{limits:?}");
    }
}

/// A plain case.
fn plain() -> Case {
    Case {
        density: Density::Voxels,
        extinction: &[1.0],
        per_voxel: false,
        rule: (4, true),
        column: Column::Rays,
        lights: lights().remove(3),
    }
}

#[test]
fn what_a_lost_device_leaves_the_cpu_finds() {
    let Some(_) = for_tests() else { return };
    let gpu = Gpu::new(&adapter::choose("").expect("an adapter")).expect("it opens");
    gpu.lose();
    let device = Device::Gpu(Arc::new(gpu));
    let on = |device| with(&plain(), |plan, views| single(plan, views, device, &Control::new(None)).expect("it runs"));
    assert!(on(&device).fluence == on(&Device::Cpu).fluence);
}

#[test]
fn a_stopped_run_ends() {
    let Some(gpu) = for_tests() else { return };
    let control = Control::new(None);
    control.stop();
    let found = with(&plain(), |plan, views| single(plan, views, &Device::Gpu(gpu), &control).map(|_| ()));
    assert!(matches!(found, Err(Error::Interrupted)));
}
