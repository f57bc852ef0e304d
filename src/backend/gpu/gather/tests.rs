//! Images of the GPU against those of the CPU.

use super::*;
use crate::backend::Control;
use crate::backend::cpu::gather::{self as cpu, by_cells};
use crate::backend::gpu::device::for_tests;
use crate::physics::Phase;
use crate::plan::Column;
use crate::scene::environment::Map;
use crate::scene::field::Occupancy;
use crate::scene::{Albedo, Camera, Emission, Light, Medium, Scene, Spectrum, Volume};

const N: [usize; 3] = [14, 11, 9];
const H: [f64; 3] = [1.0, 1.2, 0.8];
const ORIGIN: [f64; 3] = [3.0, -2.0, 100.0];
const UP: [f64; 3] = [0.0, 0.0, 1.0];

/// What a scene is made of, and how it is seen.
#[derive(Clone)]
struct Case {
    linear: bool,
    constant: bool,
    extinction: Vec<f64>,
    per_voxel: bool,
    phase: Phase,
    lights: Vec<Light>,
    column: Column,
    source0: bool,
    emission: usize,
    stride: usize,
    camera: Camera,
    pixels: Option<Vec<usize>>,
}

/// A point in the world from one in parts of the box.
fn place(part: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|a| ORIGIN[a] + part[a] * N[a] as f64 * H[a])
}

fn perspective(eye: [f64; 3], fov: f64) -> Camera {
    Camera::perspective(place(eye), place([0.5; 3]), UP, fov, [24, 20]).expect("valid")
}

fn point(part: [f64; 3]) -> Light {
    Light::point(place(part), &[100.0]).expect("valid")
}

fn parallel() -> Light {
    Light::directional([-1.0, 0.3, -0.6], &[2.0]).expect("valid")
}

impl Default for Case {
    fn default() -> Self {
        Case {
            linear: true,
            constant: false,
            extinction: vec![0.5],
            per_voxel: false,
            phase: Phase::Isotropic,
            lights: vec![point([1.8, -0.7, 1.6])],
            column: Column::Grid,
            source0: false,
            emission: 0,
            stride: 1,
            camera: perspective([2.5, -1.5, 1.4], 30.0),
            pixels: None,
        }
    }
}

fn spectrum(values: &[f64]) -> Spectrum {
    Spectrum::new(values, "value").expect("valid")
}

/// A value for each voxel.
fn field(value: impl Fn([f32; 3]) -> f32) -> Vec<f32> {
    (0..N[0] * N[1] * N[2])
        .map(|at| value([at % N[0], at / N[0] % N[1], at / (N[0] * N[1])].map(|c| c as f32)))
        .collect()
}

impl Case {
    /// What `look` gives for the case's volumes.
    fn with<T>(&self, look: impl FnOnce(&Volumes) -> T) -> T {
        let channels = self.extinction.len();
        let bumps = |p: [f32; 3]| (1.0 + (0.9 * p[0]).sin() * (0.7 * p[1] + 1.0).cos() * (0.8 * p[2]).sin()) * 0.7;
        let density = if self.constant { vec![0.6; N[0] * N[1] * N[2]] } else { field(|p| (bumps(p) - 0.4).max(0.0)) };
        let albedo = field(|p| 0.5 + 0.4 * (0.3 * p[0] + 0.2 * p[1]).sin());
        let j = field(|p| 2.0 + (0.9 * p[0] + 0.7 * p[2] - 0.4 * p[1]).cos());
        let times = |count: usize| -> Vec<f32> {
            j.iter()
                .enumerate()
                .flat_map(|(at, j)| (0..count).map(move |s| j * (1.0 + s as f32) + ((at + s) % 5) as f32))
                .collect()
        };
        let (source, source0) = (times(self.stride), times(channels));
        let volume = Volume::new(&density, N, H, ORIGIN, self.linear).expect("valid");
        let constant = Albedo::Constant(spectrum(&[0.9, 0.8, 0.7][..channels]));
        let albedo = if self.per_voxel { Albedo::PerVoxel(&albedo) } else { constant };
        let medium = Medium::new(volume, spectrum(&self.extinction), albedo, self.phase.clone()).expect("valid");
        let glow: Vec<f32> = [0.3, 0.2, 0.4][..self.emission]
            .iter()
            .flat_map(|scale| {
                field(|p| (scale * (1.0 + (0.7 * p[0] - scale * p[1] + 0.5 * p[2]).sin()) - 0.2).max(0.0))
            })
            .collect();
        let emission = (self.emission > 0).then(|| Emission::new(&glow, self.emission, &volume).expect("valid"));
        let medium = medium.emitting(emission);
        let scene = Scene::new(medium, self.lights.clone(), self.camera);
        let view = |light, nodes| Illumination::new(&scene, None, light, self.column, nodes);
        let grids: Vec<Option<Vec<f32>>> =
            self.lights.iter().map(|light| view(light, None).map(|view| view.columns(&Control::new(None)))).collect();
        let lights = self.lights.iter().zip(&grids);
        let lights = lights.filter_map(|(light, grid)| view(light, grid.as_deref())).collect();
        let source0 = self.source0.then_some(source0.as_slice());
        look(&Volumes { scene: &scene, occupancy: None, lights, source: Some(&source), source0, channels })
    }

    fn on_gpu(&self, volumes: &Volumes) -> Image {
        let gpu = Gpu::open("").expect("an adapter");
        image(&gpu, volumes, &self.camera, self.pixels.as_deref(), self.stride, true, &|| false).expect("it runs")
    }
}

/// The largest difference of two layers over the largest value of the second.
fn difference(found: &[f32], expected: &[f32]) -> f32 {
    assert_eq!(found.len(), expected.len());
    let top = expected.iter().fold(0.0f32, |m, x| m.max(x.abs()));
    let worst = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0f32, f32::max);
    assert!(found.iter().all(|x| x.is_finite()));
    if top > 0.0 { worst / top } else { worst }
}

/// The differences of all layers.
fn differences(found: &Image, expected: &Image) -> [f32; 5] {
    [
        difference(&found.order1, &expected.order1),
        difference(&found.order2, &expected.order2),
        difference(&found.transmittance, &expected.transmittance),
        difference(&found.emitted, &expected.emitted),
        difference(&found.background, &expected.background),
    ]
}

fn cases() -> Vec<(&'static str, Case)> {
    let one = Case::default();
    let hg = Phase::henyey_greenstein(0.8).expect("valid");
    let table = Phase::tabulated(&[-1.0, -0.2, 0.5, 1.0], &[0.3, 0.1, 0.4, 3.0]).expect("valid");
    let inside = point([0.52, 0.47, 0.55]);
    let far = [0.5 + 1e6, 0.5 - 1e6, 0.5 + 5e5];
    let sky = Light::environment(&[0.7]).expect("valid");
    let rgb = vec![0.5, 0.3, 0.8];
    let on_ray = |camera: &Camera| {
        let (start, d) = camera.ray(12.0 + 9.5 / 16.0, 11.0 + 3.5 / 16.0);
        let way = (0..3).map(|a| (place([0.5; 3])[a] - start[a]) * d[a]).sum::<f64>();
        vec![Light::point(std::array::from_fn(|a| start[a] + way * d[a]), &[100.0]).expect("valid")]
    };
    let wide = Camera::orthographic(place([2.0, -1.0, 1.5]), place([0.5; 3]), UP, 25.0, [24, 20]).expect("valid");
    vec![
        ("linear", one.clone()),
        ("nearest", Case { linear: false, ..one.clone() }),
        ("constant, linear", Case { constant: true, ..one.clone() }),
        ("constant, nearest", Case { constant: true, linear: false, ..one.clone() }),
        ("light rays", Case { column: Column::Rays, ..one.clone() }),
        ("light rays, nearest", Case { column: Column::Rays, linear: false, ..one.clone() }),
        ("deep", Case { extinction: vec![40.0], ..one.clone() }),
        ("hg", Case { phase: hg.clone(), ..one.clone() }),
        ("rayleigh", Case { phase: Phase::Rayleigh, ..one.clone() }),
        ("tabulated", Case { phase: table, ..one.clone() }),
        ("albedo per voxel", Case { per_voxel: true, ..one.clone() }),
        ("albedo per voxel, nearest", Case { per_voxel: true, linear: false, ..one.clone() }),
        ("source0", Case { source0: true, ..one.clone() }),
        ("rgb", Case { extinction: rgb.clone(), stride: 3, source0: true, phase: hg.clone(), ..one.clone() }),
        ("rgb, per voxel", Case { extinction: rgb.clone(), stride: 3, per_voxel: true, linear: false, ..one.clone() }),
        ("lights", Case { lights: vec![parallel(), point([1.8, -0.7, 1.6]), parallel(), sky], ..one.clone() }),
        ("emission", Case { emission: 1, extinction: vec![3.0], ..one.clone() }),
        ("emission, nearest", Case { emission: 1, linear: false, ..one.clone() }),
        ("emission, rgb", Case { emission: 3, extinction: rgb.clone(), stride: 3, ..one.clone() }),
        ("no light", Case { lights: Vec::new(), ..one.clone() }),
        ("light inside", Case { lights: vec![inside.clone()], ..one.clone() }),
        (
            "light inside, rays",
            Case { lights: vec![inside, parallel()], column: Column::Rays, phase: hg, ..one.clone() },
        ),
        ("light on a ray", Case { lights: on_ray(&one.camera), ..one.clone() }),
        ("light on a ray, orthographic", Case { lights: on_ray(&wide), camera: wide, ..one.clone() }),
        ("orthographic", Case { camera: wide, ..one.clone() }),
        ("from within", Case { camera: perspective([0.3, 0.4, 0.6], 100.0), ..one.clone() }),
        ("from within, wide", Case { camera: perspective([0.3, 0.4, 0.6], 179.95), ..one.clone() }),
        ("from far away", Case { camera: perspective(far, 6e-5), ..one.clone() }),
        ("pixels", Case { pixels: Some(vec![250, 7, 130, 131, 479]), ..one }),
    ]
}

#[test]
fn the_image_is_that_of_the_cpu_cell_by_cell() {
    if for_tests().is_none() {
        return;
    }
    let mut failed = Vec::new();
    for (name, case) in cases() {
        let worst = case.with(|volumes| {
            let expected = by_cells(volumes, &case.camera, case.pixels.as_deref());
            assert!(expected.order2.iter().any(|&x| x > 0.0), "{name}");
            differences(&case.on_gpu(volumes), &expected)
        });
        // What is deep is seen through many exponentials.
        if worst.iter().any(|&d| d > 2e-5) {
            failed.push((name, worst));
        }
    }
    assert!(failed.is_empty(), "{failed:?}");
}

#[test]
fn the_image_does_not_depend_on_the_cut() {
    let Some(gpu) = for_tests() else { return };
    let inside = point([0.52, 0.47, 0.55]);
    let lights = vec![inside, parallel()];
    let case = Case { extinction: vec![5.0], lights, column: Column::Rays, stride: 8, emission: 1, ..Case::default() };
    case.with(|volumes| {
        let with = |rays, cells| {
            gather(&gpu, volumes, &case.camera, None, (8, true), Cut { rays, cells }, &|| false).expect("it runs")
        };
        let (one, other) = (with(1 << 14, 1 << 28), with(3000, 1 << 18));
        let layers =
            |image: &Image| [&image.order1, &image.order2, &image.transmittance, &image.emitted].map(Vec::clone);
        assert!(layers(&one) == layers(&other));
        assert!(layers(&one).iter().all(|layer| layer.iter().any(|&x| x > 0.0)));
    });
}

#[test]
fn replicates_are_those_of_the_cpu_one_by_one() {
    if for_tests().is_none() {
        return;
    }
    for (extinction, k) in [(vec![0.5], 8), (vec![0.5], 5), (vec![0.5, 0.3, 0.8], 8), (vec![0.5, 0.3, 0.8], 2)] {
        let channels = extinction.len();
        let case = Case { extinction, stride: channels * k, ..Case::default() };
        case.with(|volumes| {
            let found = case.on_gpu(volumes);
            for replicate in 0..k {
                let own = |values: &[f32]| -> Vec<f32> { values.iter().skip(replicate).step_by(k).copied().collect() };
                let slice = volumes.source.map(own);
                let one = Volumes { source: slice.as_deref(), lights: volumes.lights.clone(), ..*volumes };
                let expected = by_cells(&one, &case.camera, None);
                assert!(difference(&own(&found.order2), &expected.order2) < 2e-6, "{replicate} of {k}");
                assert!(difference(&found.order1, &expected.order1) < 2e-6);
            }
        });
    }
}

#[test]
fn even_steps_of_the_cpu_differ_by_their_quadrature_only() {
    if for_tests().is_none() {
        return;
    }
    let case = Case { extinction: vec![0.1], ..Case::default() };
    case.with(|volumes| {
        let expected = cpu::image(volumes, &case.camera, None, 1, true, &|| false);
        let worst = differences(&case.on_gpu(volumes), &expected);
        assert!(worst[0] > 1e-5, "these are no even steps");
        assert!(worst.iter().all(|&d| d < 5e-3), "{worst:?}");
    });
}

#[test]
fn a_stop_is_an_error() {
    let Some(gpu) = for_tests() else { return };
    let case = Case::default();
    case.with(|volumes| {
        let stopped = image(&gpu, volumes, &case.camera, None, 1, true, &|| true);
        assert_eq!(stopped.err(), Some(Error::Interrupted));
    });
}

#[test]
fn long_light_rays_from_every_step_end() {
    let Some(gpu) = for_tests() else { return };
    let n = [700usize, 3, 2];
    let density: Vec<f32> = (0..4200).map(|i| 0.5 + ((i * 7919) % 101) as f32 / 100.0).collect();
    let volume = Volume::new(&density, n, [1.0; 3], [0.0; 3], true).expect("valid");
    let medium = Medium::new(volume, spectrum(&[0.004]), Albedo::Constant(spectrum(&[0.9])), Phase::Isotropic);
    let camera = Camera::perspective([-9.0, 1.4, 1.1], [700.0, 1.5, 1.0], UP, 9.0, [3, 3]).expect("valid");
    let light = Light::directional([-1.0, 0.0005, 0.0004], &[2.0]).expect("valid");
    let scene = Scene::new(medium.expect("valid"), vec![light], camera);
    let lights = Illumination::new(&scene, None, &scene.lights[0], Column::Rays, None).into_iter().collect();
    let volumes = Volumes { scene: &scene, occupancy: None, lights, source: None, source0: None, channels: 1 };
    let found = image(&gpu, &volumes, &camera, None, 1, true, &|| false).expect("it runs");
    let expected = by_cells(&volumes, &camera, None);
    assert!(expected.order1[4] > 0.0 && expected.transmittance[4] < 0.9);
    let worst = differences(&found, &expected);
    assert!(worst.iter().all(|&d| d < 2e-5), "{worst:?}");
}

#[test]
fn empty_blocks_are_passed_and_nothing_else() {
    let Some(gpu) = for_tests() else { return };
    let n = [40usize, 25, 33];
    let value = |at: usize| {
        let (i, j, k) = (at % n[0], at / n[0] % n[1], at / (n[0] * n[1]));
        if (i / 5 + j / 7 + k / 9) % 5 == 0 { ((at * 7919) % 101) as f32 / 100.0 } else { 0.0 }
    };
    let density: Vec<f32> = (0..n.iter().product()).map(value).collect();
    for linear in [false, true] {
        let volume = Volume::new(&density, n, [1.0; 3], [0.0; 3], linear).expect("valid");
        let medium = Medium::new(volume, spectrum(&[0.5]), Albedo::Constant(spectrum(&[0.9])), Phase::Isotropic);
        let camera = Camera::perspective([90.0, -60.0, 50.0], [20.0, 12.0, 16.0], UP, 35.0, [24, 20]).expect("valid");
        let scene = Scene::new(medium.expect("valid"), vec![parallel()], camera);
        let occupancy = Occupancy::new(&scene.medium.volume).expect("much is empty");
        let lights: Vec<_> =
            Illumination::new(&scene, None, &scene.lights[0], Column::Rays, None).into_iter().collect();
        let with = |occupancy| {
            let volumes = Volumes {
                scene: &scene,
                occupancy,
                lights: lights.clone(),
                source: Some(&density),
                source0: None,
                channels: 1,
            };
            let found = image(&gpu, &volumes, &camera, None, 1, true, &|| false).expect("it runs");
            let cut = Cut { rays: 300, cells: 1 << 13 };
            let again = gather(&gpu, &volumes, &camera, None, (1, true), cut, &|| false).expect("it runs");
            assert!(found.order1 == again.order1 && found.order2 == again.order2);
            (found, by_cells(&volumes, &camera, None))
        };
        for occupancy in [None, Some(&occupancy)] {
            let (found, expected) = with(occupancy);
            let worst = differences(&found, &expected);
            assert!(worst.iter().all(|&d| d < 5e-6), "{linear} {}: {worst:?}", occupancy.is_some());
        }
    }
}

#[test]
fn balls_and_flat_volumes_are_seen_as_on_the_cpu() {
    let Some(gpu) = for_tests() else { return };
    for (n, ball) in [([1usize, 1, 1], true), ([1, 1, 1], false), ([5, 1, 3], false)] {
        let density: Vec<f32> = (0..n.iter().product()).map(|i| 0.5 + i as f32).collect();
        let volume = Volume::new(&density, n, [2.0; 3], ORIGIN, false).expect("valid");
        let volume = if ball { volume.ball().expect("valid") } else { volume };
        let eye = [ORIGIN[0] + 9.0, ORIGIN[1] - 14.0, ORIGIN[2] + 6.0];
        let target = [ORIGIN[0] + n[0] as f64, ORIGIN[1] + 1.0, ORIGIN[2] + n[2] as f64];
        let camera = Camera::perspective(eye, target, UP, 30.0, [24, 20]).expect("valid");
        let sky = Map::new((0..128).map(|i| ((i * 7) % 11) as f32).collect(), 16, 8, 1).expect("valid");
        let lights =
            vec![parallel(), Light::environment_map(sky).expect("valid"), Light::environment(&[0.5]).expect("valid")];
        let medium = Medium::new(volume, spectrum(&[0.4]), Albedo::Constant(spectrum(&[0.9])), Phase::Rayleigh);
        let scene = Scene::new(medium.expect("valid"), lights, camera);
        let lights = Illumination::new(&scene, None, &scene.lights[0], Column::Rays, None).into_iter().collect();
        let source: Vec<f32> = density.iter().map(|d| 1.0 + 0.3 * d).collect();
        let volumes =
            Volumes { scene: &scene, occupancy: None, lights, source: Some(&source), source0: None, channels: 1 };
        let found = image(&gpu, &volumes, &camera, None, 1, true, &|| false).expect("it runs");
        let worst = differences(&found, &by_cells(&volumes, &camera, None));
        assert!(worst.iter().all(|&d| d < 2e-5), "{n:?} {ball}: {worst:?}");
    }
}
