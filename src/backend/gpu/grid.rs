//! The light grid on the GPU.

use super::device::Gpu;
use super::kernel::Binding;
use super::lights::Lights;
use super::scene::GpuScene;
use crate::backend::Control;
use crate::backend::cpu::light::Illumination;
use crate::error::{Error, Result};
use bytemuck::{Pod, Zeroable};

/// `Job` of `shaders/columns.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[expect(missing_docs, reason = "the shader names and describes them")]
pub struct Job {
    pub first: u32,
    pub end: u32,
    pub light: u32,
    pub spare: u32,
}

/// Light rays of a dispatch.
const RAYS: usize = 1 << 18;

/// The column densities at the nodes of a light's grid ([`Illumination::columns`]).
pub fn columns(gpu: &Gpu, scene: &GpuScene, view: &Illumination, control: &Control) -> Result<Vec<f32>> {
    let nodes: usize = scene.constants.n.iter().map(|&m| m as usize + 2).product();
    let lights = Lights::new(gpu, std::iter::once((view, 1.0)))?;
    let kernel = gpu.kernel(scene.source(&["columns", "light"]))?;
    let columns = gpu.empty(nodes as u64 * 4)?;
    let mut bindings = scene.bindings();
    bindings.extend(lights.bindings());
    bindings.push(("columns", Binding::Buffer(&columns)));
    let job = gpu.uniform(&Job::zeroed())?;
    bindings.push(("job", Binding::Buffer(&job)));
    for first in (0..nodes).step_by(RAYS) {
        if control.stopped() {
            return Err(Error::Interrupted);
        }
        let count = RAYS.min(nodes - first);
        gpu.write(&job, 0, &[Job { first: first as u32, end: (first + count) as u32, light: 0, spare: 0 }]);
        gpu.run(&kernel, &bindings, count as u64)?;
    }
    gpu.read(&columns, nodes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::Phase;
    use crate::plan::Column;
    use crate::scene::{Albedo, Camera, Light, Medium, Scene, Spectrum, Volume};

    #[test]
    fn light_rays_are_those_of_the_cpu() {
        let gpu = Gpu::open("").expect("an adapter");
        let n = [7usize, 5, 6];
        let density: Vec<f32> = (0..210).map(|i| ((i * 7919) % 101) as f32 / 100.0).collect();
        let grey = |v: f64| Spectrum::new(&[v], "value").expect("valid");
        for linear in [false, true] {
            let volume = Volume::new(&density, n, [0.5, 1.0, 2.0], [0.0; 3], linear).expect("valid");
            let medium = Medium::new(volume, grey(2.0), Albedo::Constant(grey(0.9)), Phase::Isotropic).expect("valid");
            let light = Light::point([-3.0, 9.0, 20.0], &[1.0]).expect("valid");
            let camera =
                Camera::perspective([30.0, -30.0, 20.0], [2.0; 3], [0.0, 0.0, 1.0], 20.0, [9, 9]).expect("valid");
            let scene = Scene::new(medium, vec![light], camera);
            let view = Illumination::new(&scene, None, &scene.lights[0], Column::Rays, None).expect("a point");
            let on_gpu = GpuScene::new(&gpu, &scene, 1).expect("it fits");
            let found = columns(&gpu, &on_gpu, &view, &Control::new(None)).expect("it runs");
            for (at, found) in found.iter().enumerate() {
                let node = [at % 9, at / 9 % 7, at / 63].map(|c| c as f32 - 0.5);
                if (0..3).all(|a| node[a] > 0.0 && node[a] < n[a] as f32) {
                    let truth = view.ray(node, &view.incident(node));
                    assert!(
                        (found - truth).abs() < 1e-5 * truth.max(0.1),
                        "linear {linear} {node:?}: {found}, {truth}"
                    );
                }
            }
        }
    }
}
