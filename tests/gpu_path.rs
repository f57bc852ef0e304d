//! Paths on the GPU are those of the CPU: they draw the same random numbers, so that pixels agree but for rounding, and for
//! the rare path whose fate hangs on it.
#![cfg(feature = "gpu")]

use mcrt::backend::cpu::path;
use mcrt::backend::gpu::Gpu;
use mcrt::backend::{Control, Device};
use mcrt::physics::Phase;
use mcrt::plan::{Method, Settings, Simd, Tracker};
use mcrt::result::{Outcome, Stopped};
use mcrt::scene::environment::Map;
use mcrt::scene::medium::Emission;
use mcrt::scene::{Albedo, Camera, Light, Medium, Scene, Spectrum, Volume};
use mcrt::{Error, Plan};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What a row of the table says of a scene.
#[derive(Clone)]
struct Case {
    name: &'static str,
    density: fn([usize; 3]) -> f32,
    n: [usize; 3],
    linear: bool,
    ball: bool,
    extinction: &'static [f64],
    /// Empty for one that differs from voxel to voxel.
    albedo: &'static [f64],
    /// Channels.
    emission: usize,
    phase: Phase,
    lights: Vec<Light>,
    camera: Camera,
    settings: Settings,
}

fn hash(i: usize) -> f32 {
    ((i * 7919 + 13) % 101) as f32 / 100.0
}

/// Densities between 0 and 1, of which some are 0.
fn noise(c: [usize; 3]) -> f32 {
    (hash(c[0] + 17 * c[1] + 311 * c[2]) - 0.2).max(0.0)
}

/// Two dense corners of a thin box.
fn spiky(c: [usize; 3]) -> f32 {
    let corner = |low: usize| c.iter().all(|&x| (low..low + 5).contains(&x));
    if corner(2) || corner(20) { 12.0 } else { 0.0 }
}

/// A cloud that is smooth.
fn smooth(c: [usize; 3]) -> f32 {
    let r2: f32 = c.iter().map(|&x| (x as f32 - 5.5).powi(2)).sum();
    (1.0 - r2 / 36.0).max(0.0)
}

fn spectrum(values: &[f64]) -> Spectrum {
    Spectrum::new(values, "value").expect("valid")
}

fn eye(origin: [f64; 3]) -> Camera {
    Camera::perspective(origin, [0.5; 3], [0.0, 0.0, 1.0], 35.0, [33, 27]).expect("valid")
}

fn sun() -> Light {
    Light::directional([0.3, 0.2, -1.0], &[1.0]).expect("valid")
}

fn lamp(position: [f64; 3]) -> Light {
    Light::point(position, &[1.0]).expect("valid")
}

fn sky(channels: usize) -> Light {
    let texels = (0..8 * 4 * channels).map(|i| if i == 5 { 20.0 } else { hash(i) }).collect();
    Light::environment_map(Map::new(texels, 8, 4, channels).expect("valid")).expect("valid")
}

/// The table: each row says what differs from the first.
fn cases() -> Vec<Case> {
    let hg = |g: f64| Phase::henyey_greenstein(g).expect("valid");
    let table = Phase::tabulated(&[-1.0, -0.2, 0.5, 1.0], &[0.3, 0.1, 0.4, 3.0]).expect("valid");
    let base = Case {
        name: "homogeneous",
        density: |_| 1.0,
        n: [2, 2, 2],
        linear: false,
        ball: false,
        extinction: &[4.0],
        albedo: &[0.9],
        emission: 0,
        phase: Phase::Isotropic,
        lights: vec![sun()],
        camera: eye([2.0, -3.0, 2.0]),
        settings: Settings {
            method: Some(Method::Path),
            spp: Some(16),
            fluence: false,
            radiance: false,
            ..Settings::default()
        },
    };
    let cloud = Case { name: "voxels", density: noise, n: [9, 7, 8], extinction: &[8.0], ..base.clone() };
    let soft = Case { name: "linear", linear: true, ..cloud.clone() };
    let thin = Case { name: "thin", extinction: &[0.8], ..cloud.clone() };
    let with = |case: &Case, settings: Settings| Settings {
        method: case.settings.method,
        spp: settings.spp.or(case.settings.spp),
        fluence: false,
        radiance: false,
        ..settings
    };
    let set = |case: &Case, name, settings: Settings| Case { name, settings: with(case, settings), ..case.clone() };
    let none = Settings::default;
    let mut list = vec![
        base.clone(),
        Case { name: "dense", extinction: &[60.0], albedo: &[1.0], ..base.clone() },
        cloud.clone(),
        soft.clone(),
        thin.clone(),
        Case { name: "thin linear", linear: true, ..thin.clone() },
        Case { name: "spiky", density: spiky, n: [26, 26, 26], extinction: &[8.0], ..base.clone() },
        Case {
            name: "spiky linear",
            density: spiky,
            n: [26, 26, 26],
            extinction: &[8.0],
            linear: true,
            ..base.clone()
        },
        Case { name: "smooth, light grid", density: smooth, n: [12, 12, 12], linear: true, ..base.clone() },
        Case { name: "far lamp", lights: vec![lamp([2.0, 1.0, 3.0]), sun()], ..soft.clone() },
        Case { name: "lamp within", lights: vec![lamp([0.4, 0.6, 0.5])], ..soft.clone() },
        Case { name: "lamp within voxels, hg", lights: vec![lamp([0.4, 0.6, 0.5])], phase: hg(0.6), ..thin.clone() },
        Case {
            name: "two lamps and a sun",
            lights: vec![lamp([0.4, 0.6, 0.5]), sun(), lamp([0.5, 0.5, 1.1])],
            ..cloud.clone()
        },
        Case { name: "lamp within a homogeneous box", lights: vec![lamp([0.4, 0.6, 0.5])], ..base.clone() },
        Case { name: "hg", phase: hg(0.8), ..soft.clone() },
        Case { name: "hg backward", phase: hg(-0.4), ..cloud.clone() },
        Case { name: "rayleigh", phase: Phase::Rayleigh, ..soft.clone() },
        Case { name: "tabulated", phase: table, ..cloud.clone() },
        Case { name: "rgb", albedo: &[0.9, 0.7, 0.3], ..soft.clone() },
        Case {
            name: "rgb, lamp within",
            albedo: &[0.9, 0.7, 0.3],
            lights: vec![lamp([0.4, 0.6, 0.5])],
            ..soft.clone()
        },
        Case { name: "albedo by voxel", albedo: &[], ..soft.clone() },
        Case { name: "albedo by voxel, constant density", albedo: &[], n: [5, 4, 3], ..base.clone() },
        Case { name: "sky", lights: vec![Light::environment(&[0.7]).expect("valid")], ..cloud.clone() },
        Case { name: "map", lights: vec![sky(1)], phase: hg(0.5), ..cloud.clone() },
        Case {
            name: "two maps, a sky and a sun",
            lights: vec![sky(3), sky(1), Light::environment(&[0.1]).expect("valid"), sun()],
            ..soft.clone()
        },
        Case { name: "thin under a map", lights: vec![sky(3)], phase: hg(0.5), ..thin.clone() },
        Case { name: "ball", ball: true, n: [1, 1, 1], ..base.clone() },
        Case {
            name: "ball, lamp within and sky",
            ball: true,
            n: [1, 1, 1],
            lights: vec![lamp([0.4, 0.6, 0.5]), sky(1)],
            ..base.clone()
        },
        Case {
            name: "parallel view",
            camera: Camera::orthographic([2.0, -3.0, 2.0], [0.5; 3], [0.0, 0.0, 1.0], 2.0, [30, 20]).expect("valid"),
            ..cloud.clone()
        },
        Case { name: "from within", camera: eye([0.3, 0.2, 0.6]), ..cloud.clone() },
        Case {
            name: "from afar",
            camera: Camera::perspective([2e3, -3e3, 2e3], [0.5; 3], [0.0, 0.0, 1.0], 0.03, [33, 27]).expect("valid"),
            ..cloud.clone()
        },
        set(&cloud, "one scattering", Settings { max_scatterings: Some(1), ..none() }),
        set(&soft, "three scatterings", Settings { max_scatterings: Some(3), ..none() }),
        Case {
            settings: with(&cloud, Settings { max_scatterings: Some(2), ..none() }),
            name: "two scatterings under a sky and a lamp",
            lights: vec![sky(1), lamp([0.4, 0.6, 0.5])],
            ..cloud.clone()
        },
        set(&cloud, "one path", Settings { spp: Some(1), ..none() }),
        set(
            &cloud,
            "three paths a ray, another seed",
            Settings { spp: Some(6), seed: 0x1234_5678_9abc_def0, ..none() },
        ),
        set(&soft, "many passes", Settings { spp: Some(600), ..none() }),
        set(&base, "homogeneous, march", Settings { tracker: Some(Tracker::March), ..none() }),
        set(&cloud, "march", Settings { tracker: Some(Tracker::March), ..none() }),
        set(&soft, "march linear", Settings { tracker: Some(Tracker::March), ..none() }),
        Case {
            settings: with(&soft, Settings { tracker: Some(Tracker::March), ..none() }),
            name: "march linear, lamp and map",
            lights: vec![lamp([0.4, 0.6, 0.5]), sky(1), sun()],
            ..soft.clone()
        },
    ];
    for (name, case) in [("scalar", &base), ("scalar voxels", &cloud), ("scalar linear", &soft), ("scalar thin", &thin)]
    {
        list.push(set(case, name, Settings { simd: Some(Simd::Scalar), ..none() }));
    }
    let uneven: &'static [f64] = &[8.0, 3.0, 5.0];
    let grid = Case {
        name: "smooth, chromatic",
        density: smooth,
        n: [12, 12, 12],
        linear: true,
        extinction: uneven,
        ..base.clone()
    };
    list.extend([
        Case {
            name: "scalar, lamps, map",
            lights: vec![lamp([0.4, 0.6, 0.5]), lamp([3.0, 3.0, 3.0]), sky(1)],
            settings: with(&soft, Settings { simd: Some(Simd::Scalar), ..none() }),
            ..soft.clone()
        },
        grid,
        Case { name: "chromatic", extinction: uneven, ..base.clone() },
        Case { name: "chromatic voxels", extinction: uneven, phase: hg(0.5), ..cloud.clone() },
        Case {
            name: "chromatic thin, lamp",
            extinction: &[0.8, 0.1, 0.4],
            lights: vec![lamp([0.4, 0.6, 0.5])],
            ..cloud.clone()
        },
        Case {
            name: "chromatic march, map",
            extinction: uneven,
            lights: vec![sky(3)],
            settings: with(&soft, Settings { tracker: Some(Tracker::March), ..none() }),
            ..soft.clone()
        },
        Case { name: "glow", emission: 1, ..soft.clone() },
        Case { name: "glow alone", emission: 1, lights: vec![], ..thin.clone() },
        Case { name: "glow of a homogeneous box", emission: 1, n: [5, 4, 3], ..base.clone() },
        Case { name: "rgb glow", emission: 3, ..cloud.clone() },
        Case { name: "chromatic glow", emission: 3, extinction: uneven, ..soft.clone() },
        Case {
            name: "chromatic glow, two scatterings",
            emission: 1,
            extinction: uneven,
            settings: with(&soft, Settings { max_scatterings: Some(2), ..none() }),
            ..cloud.clone()
        },
    ]);
    list
}

/// Calls `f` with a case's plan.
fn with_plan<T>(case: &Case, f: impl FnOnce(&Plan) -> T) -> T {
    let voxels: usize = case.n.iter().product();
    let at = |i: usize| [i % case.n[0], i / case.n[0] % case.n[1], i / (case.n[0] * case.n[1])];
    let density: Vec<f32> = (0..voxels).map(|i| (case.density)(at(i))).collect();
    let albedo: Vec<f32> = (0..voxels).map(|i| 0.3 + 0.7 * hash(31 * i)).collect();
    let glow: Vec<f32> = (0..voxels * case.emission).map(|i| hash(5 * i)).collect();
    let spacing = case.n.map(|m| 1.0 / m as f64);
    let mut volume = Volume::new(&density, case.n, spacing, [0.0; 3], case.linear).expect("valid");
    if case.ball {
        volume = volume.ball().expect("one voxel");
    }
    let emission = (case.emission > 0).then(|| Emission::new(&glow, case.emission, &volume).expect("valid"));
    let albedo = match case.albedo {
        [] => Albedo::PerVoxel(&albedo),
        constant => Albedo::Constant(spectrum(constant)),
    };
    let medium = Medium::new(volume, spectrum(case.extinction), albedo, case.phase.clone()).expect("valid");
    let scene = Scene::new(medium.emitting(emission), case.lights.clone(), case.camera);
    f(&Plan::new(&scene, &case.settings).expect("a plan"))
}

fn run(case: &Case, device: &Device) -> Outcome {
    with_plan(case, |plan| path::run(plan, device, &Control::new(None), None).expect("a run").0)
}

fn gpu() -> Arc<Gpu> {
    Gpu::open("").expect("an adapter")
}

#[test]
fn images_are_those_of_the_cpu() {
    let device = Device::Gpu(gpu());
    let (mut flips, mut all) = (0, 0);
    for case in cases() {
        let (cpu, gpu) = (run(&case, &Device::Cpu), run(&case, &device));
        let name = case.name;
        let events = (gpu.collisions as f64 / cpu.collisions as f64 - 1.0).abs();
        assert!(events < 1e-3, "{name}: {} collisions, {}", gpu.collisions, cpu.collisions);
        assert_eq!((gpu.photons, gpu.batches), (cpu.photons, cpu.batches), "{name}");
        let [a, b] = [cpu, gpu].map(|outcome| outcome.pixels.expect("an image"));
        let mut off = 0;
        for (what, a, b) in
            [("one", &a.order1, &b.order1), ("more", &a.order2, &b.order2), ("error", &a.error, &b.error)]
        {
            let mean = a.iter().filter(|x| x.is_finite()).sum::<f32>() / a.len() as f32;
            let differs = |(a, b): &(&f32, &f32)| (*a - *b).abs() > 1e-4 * a.max(0.01 * mean);
            let count = a.iter().zip(b).filter(differs).count();
            println!("{name:45} {what:6} {count} of {} pixels differ", a.len());
            off = off.max(count);
            let sums = [a, b].map(|x| x.iter().filter(|x| x.is_finite()).map(|&x| f64::from(x)).sum::<f64>());
            assert!(
                (sums[1] - sums[0]).abs() <= 1e-3 * sums[0],
                "{name}: {what} is {} in all, and {}",
                sums[1],
                sums[0]
            );
        }
        assert!(off <= 5 + a.order1.len() / 200, "{name}: {off} of {} pixels differ", a.order1.len());
        (flips, all) = (flips + off, all + a.order1.len());
    }
    println!("{flips} of {all} pixels differ");
    assert!(flips * 1000 < all, "{flips} of {all} pixels differ");
}

/// A case that takes long.
fn long() -> Case {
    let mut case = cases().swap_remove(1);
    case.settings.spp = Some(1 << 20);
    case
}

#[test]
fn runs_end_when_they_are_told_to() {
    let device = Device::Gpu(gpu());
    let case = long();
    with_plan(&case, |plan| {
        let control = Control::new(None);
        std::thread::scope(|scope| {
            let run = scope.spawn(|| path::run(plan, &device, &control, None));
            std::thread::sleep(Duration::from_millis(300));
            let asked = Instant::now();
            control.stop();
            let ended = run.join().expect("no panic");
            assert!(matches!(ended, Err(Error::Interrupted)));
            assert!(asked.elapsed() < Duration::from_secs(2), "{:?}", asked.elapsed());
        });
        let control = Control::new(Some(0.5));
        let (outcome, unfinished) = path::run(plan, &device, &control, None).expect("a run");
        assert!(outcome.stopped == Stopped::TimeLimit && outcome.batches >= 2 && unfinished.is_none());
        let cpu =
            Case { settings: Settings { spp: Some(4 * outcome.batches), ..case.settings.clone() }, ..case.clone() };
        let [a, b] = [outcome, run(&cpu, &Device::Cpu)].map(|o| o.pixels.expect("an image").order2);
        let sums = [a, b].map(|x| x.iter().map(|&x| f64::from(x)).sum::<f64>());
        assert!((sums[0] / sums[1] - 1.0).abs() < 1e-3, "{sums:?}");
    });
}

#[test]
fn a_lost_device_costs_one_pass() {
    let mut case = cases().swap_remove(2);
    case.settings.spp = Some(4 * 64 * 24);
    let whole = run(&case, &Device::Gpu(gpu())).pixels.expect("an image");
    with_plan(&case, |plan| {
        let adapter = mcrt::backend::gpu::adapter::choose("").expect("an adapter");
        let lost = Arc::new(Gpu::new(&adapter).expect("it opens"));
        let device = Device::Gpu(lost.clone());
        let control = Control::new(None);
        let ended = std::thread::scope(|scope| {
            let run = scope.spawn(|| path::run(plan, &device, &control, None));
            while control.progress().0 == 0.0 {
                std::thread::sleep(Duration::from_millis(1));
            }
            lost.lose();
            run.join().expect("no panic")
        });
        let (outcome, unfinished) = ended.expect("what was finished");
        assert!(outcome.stopped == Stopped::DeviceLost && outcome.batches >= 1);
        let (why, taken) = unfinished.expect("a rest");
        assert!(matches!(why, Error::DeviceLost(_)));
        let rest = path::run(plan, &Device::Gpu(gpu()), &Control::new(None), Some(taken)).expect("a run").0;
        let rest = rest.pixels.expect("an image");
        assert_eq!((rest.order1, rest.order2, rest.error), (whole.order1, whole.order2, whole.error));
    });
}
