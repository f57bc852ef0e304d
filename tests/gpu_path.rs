//! Paths on the GPU are those of the CPU: they draw the same random numbers, so that pixels agree but for rounding, and for
//! the rare path whose fate hangs on it.
#![cfg(feature = "gpu")]

use mcrt::backend::cpu::path;
use mcrt::backend::gpu::Gpu;
use mcrt::backend::{Control, Device};
use mcrt::physics::Phase;
use mcrt::plan::{Connection, Method, Settings, Simd, Tracker};
use mcrt::scene::environment::Map;
use mcrt::scene::medium::Emission;
use mcrt::scene::{Albedo, Camera, Light, Medium, Scene, Spectrum, Volume};
use mcrt::{Plan, result::Outcome};

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
        Case { name: "spiky linear", density: spiky, n: [26, 26, 26], extinction: &[8.0], linear: true, ..base.clone() },
        Case { name: "smooth, light grid", density: smooth, n: [12, 12, 12], linear: true, ..base.clone() },
        Case { name: "far lamp", lights: vec![lamp([2.0, 1.0, 3.0]), sun()], ..soft.clone() },
        Case { name: "lamp within", lights: vec![lamp([0.4, 0.6, 0.5])], ..soft.clone() },
        Case { name: "lamp within voxels, hg", lights: vec![lamp([0.4, 0.6, 0.5])], phase: hg(0.6), ..thin.clone() },
        Case { name: "two lamps and a sun", lights: vec![lamp([0.4, 0.6, 0.5]), sun(), lamp([0.5, 0.5, 1.1])], ..cloud.clone() },
        Case { name: "lamp within a homogeneous box", lights: vec![lamp([0.4, 0.6, 0.5])], ..base.clone() },
        Case { name: "hg", phase: hg(0.8), ..soft.clone() },
        Case { name: "hg backward", phase: hg(-0.4), ..cloud.clone() },
        Case { name: "rayleigh", phase: Phase::Rayleigh, ..soft.clone() },
        Case { name: "tabulated", phase: table, ..cloud.clone() },
        Case { name: "rgb", albedo: &[0.9, 0.7, 0.3], ..soft.clone() },
        Case { name: "rgb, lamp within", albedo: &[0.9, 0.7, 0.3], lights: vec![lamp([0.4, 0.6, 0.5])], ..soft.clone() },
        Case { name: "albedo by voxel", albedo: &[], ..soft.clone() },
        Case { name: "albedo by voxel, constant density", albedo: &[], n: [5, 4, 3], ..base.clone() },
        Case { name: "sky", lights: vec![Light::environment(&[0.7]).expect("valid")], ..cloud.clone() },
        Case { name: "map", lights: vec![sky(1)], phase: hg(0.5), ..cloud.clone() },
        Case { name: "two maps, a sky and a sun", lights: vec![sky(3), sky(1), Light::environment(&[0.1]).expect("valid"), sun()], ..soft.clone() },
        Case { name: "thin under a map", lights: vec![sky(3)], phase: hg(0.5), ..thin.clone() },
        Case { name: "ball", ball: true, n: [1, 1, 1], ..base.clone() },
        Case { name: "ball, lamp within and sky", ball: true, n: [1, 1, 1], lights: vec![lamp([0.4, 0.6, 0.5]), sky(1)], ..base.clone() },
        Case { name: "parallel view", camera: Camera::orthographic([2.0, -3.0, 2.0], [0.5; 3], [0.0, 0.0, 1.0], 2.0, [30, 20]).expect("valid"), ..cloud.clone() },
        Case { name: "from within", camera: eye([0.3, 0.2, 0.6]), ..cloud.clone() },
        Case { name: "from afar", camera: Camera::perspective([2e3, -3e3, 2e3], [0.5; 3], [0.0, 0.0, 1.0], 0.03, [33, 27]).expect("valid"), ..cloud.clone() },
        set(&cloud, "one scattering", Settings { max_scatterings: Some(1), ..none() }),
        set(&soft, "three scatterings", Settings { max_scatterings: Some(3), ..none() }),
        Case { settings: with(&cloud, Settings { max_scatterings: Some(2), ..none() }), name: "two scatterings under a sky and a lamp", lights: vec![sky(1), lamp([0.4, 0.6, 0.5])], ..cloud.clone() },
        set(&cloud, "one path", Settings { spp: Some(1), ..none() }),
        set(&cloud, "three paths a ray, another seed", Settings { spp: Some(6), seed: 0x1234_5678_9abc_def0, ..none() }),
        set(&soft, "many passes", Settings { spp: Some(600), ..none() }),
        set(&base, "homogeneous, march", Settings { tracker: Some(Tracker::March), ..none() }),
        set(&cloud, "march", Settings { tracker: Some(Tracker::March), ..none() }),
        set(&soft, "march linear", Settings { tracker: Some(Tracker::March), ..none() }),
        Case { settings: with(&soft, Settings { tracker: Some(Tracker::March), ..none() }), name: "march linear, lamp and map", lights: vec![lamp([0.4, 0.6, 0.5]), sky(1), sun()], ..soft.clone() },
    ];
    for (name, case) in [("scalar", &base), ("scalar voxels", &cloud), ("scalar linear", &soft), ("scalar thin", &thin)] {
        list.push(set(case, name, Settings { simd: Some(Simd::Scalar), ..none() }));
    }
    let uneven: &'static [f64] = &[8.0, 3.0, 5.0];
    let grid = Case { name: "smooth, chromatic", density: smooth, n: [12, 12, 12], linear: true, extinction: uneven, ..base.clone() };
    list.extend([
        Case { name: "scalar, lamps, map", lights: vec![lamp([0.4, 0.6, 0.5]), lamp([3.0, 3.0, 3.0]), sky(1)], settings: with(&soft, Settings { simd: Some(Simd::Scalar), ..none() }), ..soft.clone() },
        grid,
        Case { name: "chromatic", extinction: uneven, ..base.clone() },
        Case { name: "chromatic voxels", extinction: uneven, phase: hg(0.5), ..cloud.clone() },
        Case { name: "chromatic thin, lamp", extinction: &[0.8, 0.1, 0.4], lights: vec![lamp([0.4, 0.6, 0.5])], ..cloud.clone() },
        Case { name: "chromatic march, map", extinction: uneven, lights: vec![sky(3)], settings: with(&soft, Settings { tracker: Some(Tracker::March), ..none() }), ..soft.clone() },
        Case { name: "glow", emission: 1, ..soft.clone() },
        Case { name: "glow alone", emission: 1, lights: vec![], ..thin.clone() },
        Case { name: "glow of a homogeneous box", emission: 1, n: [5, 4, 3], ..base.clone() },
        Case { name: "rgb glow", emission: 3, ..cloud.clone() },
        Case { name: "chromatic glow", emission: 3, extinction: uneven, ..soft.clone() },
        Case { name: "chromatic glow, two scatterings", emission: 1, extinction: uneven, settings: with(&soft, Settings { max_scatterings: Some(2), ..none() }), ..cloud.clone() },
    ]);
    list
}

/// Runs a case on a device.
fn run(case: &Case, device: &Device) -> (Outcome, Vec<Connection>) {
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
    let albedo = if case.albedo.is_empty() { Albedo::PerVoxel(&albedo) } else { Albedo::Constant(spectrum(case.albedo)) };
    let medium = Medium::new(volume, spectrum(case.extinction), albedo, case.phase.clone()).expect("valid").emitting(emission);
    let scene = Scene::new(medium, case.lights.clone(), case.camera);
    let plan = Plan::new(&scene, &case.settings).expect("a plan");
    let outcome = path::run(&plan, device, &Control::new(None)).expect("a run");
    (outcome, plan.paths.expect("paths").connections)
}

/// The image, whose pixels are sums of all orders.
fn image(outcome: &Outcome) -> Vec<f64> {
    let pixels = outcome.pixels.as_ref().expect("an image");
    pixels.order1.iter().zip(&pixels.order2).map(|(a, b)| f64::from(a + b)).collect()
}

#[test]
fn images_are_those_of_the_cpu() {
    let device = Device::Gpu(Gpu::open("").expect("an adapter"));
    let wish = std::env::var("CASE").unwrap_or_default();
    for case in cases() {
        if !case.name.contains(&wish) { continue; }
        let started = std::time::Instant::now();
        let (cpu, connections) = run(&case, &Device::Cpu);
        let middle = started.elapsed().as_secs_f64();
        let (gpu, _) = run(&case, &device);
        let end = started.elapsed().as_secs_f64() - middle;
        let (a, b) = (image(&cpu), image(&gpu));
        let bright = a.iter().filter(|x| **x > 0.0).count() as f64;
        let off = |t: f64| a.iter().zip(&b).filter(|(a, b)| (*a - *b).abs() > t * a.max(**b)).count() as f64 / bright;
        let (sum_a, sum_b) = (a.iter().sum::<f64>(), b.iter().sum::<f64>());
        println!("{:40} {bright} off 1e-5 {:.4} 1e-4 {:.4} 1e-3 {:.4} sum {:9.2e}; {} {} {connections:?} {middle:.2} {end:.2}", case.name, off(1e-5), off(1e-4), off(1e-3), sum_b / sum_a - 1.0, cpu.collisions, gpu.collisions);
    }
}
