//! Paths on the GPU are those of the CPU: the same random numbers, and for each pixel the same image but for rounding.
#![cfg(feature = "gpu")]

use mcrt::backend::cpu::path;
use mcrt::backend::gpu::Gpu;
use mcrt::backend::{Control, Device};
use mcrt::physics::Phase;
use mcrt::plan::{Method, Settings};
use mcrt::scene::{Albedo, Camera, Light, Medium, Scene, Spectrum, Volume};
use mcrt::{Plan, result::Outcome};

fn spectrum(values: &[f64]) -> Spectrum {
    Spectrum::new(values, "value").expect("valid")
}

fn run(scene: &Scene, settings: &Settings, device: &Device) -> Outcome {
    let plan = Plan::new(scene, settings).expect("a plan");
    path::run(&plan, device, &Control::new(None)).expect("a run")
}

/// Runs a scene on both, and compares.
fn compare(name: &str, scene: &Scene, settings: &Settings) {
    let gpu = Device::Gpu(Gpu::open("").expect("an adapter"));
    let settings = Settings { method: Some(Method::Path), fluence: false, radiance: false, ..settings.clone() };
    let start = std::time::Instant::now();
    let cpu = run(scene, &settings, &Device::Cpu);
    let cpu_seconds = start.elapsed().as_secs_f64();
    let start = std::time::Instant::now();
    let gpu = run(scene, &settings, &gpu);
    let gpu_seconds = start.elapsed().as_secs_f64();
    let [a, b] = [&cpu, &gpu].map(|outcome| {
        let pixels = outcome.pixels.as_ref().expect("an image");
        pixels.order1.iter().zip(&pixels.order2).map(|(a, b)| f64::from(a + b)).collect::<Vec<f64>>()
    });
    let bright = a.iter().filter(|x| **x > 0.0).count();
    let off = |t: f64| a.iter().zip(&b).filter(|(a, b)| (*a - *b).abs() > t * a.max(**b)).count() as f64 / bright as f64;
    let (sum_a, sum_b) = (a.iter().sum::<f64>(), b.iter().sum::<f64>());
    println!(
        "{name}: {bright} pixels, off by 1e-5 {:.4}, 1e-4 {:.4}, 1e-3 {:.4}; sum {:.2e}; collisions {} {}; {cpu_seconds:.2} s, {gpu_seconds:.2} s",
        off(1e-5), off(1e-4), off(1e-3), sum_b / sum_a - 1.0, cpu.collisions, gpu.collisions
    );
}

#[test]
fn images_are_those_of_the_cpu() {
    let density = vec![1.0f32; 8];
    let volume = Volume::new(&density, [2, 2, 2], [0.5; 3], [0.0; 3], false).expect("valid");
    let medium = Medium::new(volume, spectrum(&[4.0]), Albedo::Constant(spectrum(&[0.9])), Phase::Isotropic).expect("valid");
    let camera = Camera::perspective([2.0, -3.0, 2.0], [0.5; 3], [0.0, 0.0, 1.0], 30.0, [40, 30]).expect("valid");
    let light = Light::directional([0.3, 0.2, -1.0], &[1.0]).expect("valid");
    let scene = Scene::new(medium, vec![light], camera);
    compare("homogeneous", &scene, &Settings { spp: Some(16), ..Settings::default() });
}
