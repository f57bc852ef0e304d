//! From spherical harmonics of the incident radiance to what scatters towards an eye, on the GPU.

use super::device::Gpu;
use super::kernel::{Binding, Source};
use crate::backend::cpu::angular::Towards;
use crate::error::Result;
use crate::physics::harmonics::count;
use crate::scene::eye::LocalEye;
use bytemuck::{Pod, Zeroable};

/// `Job` of `shaders/angular.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[expect(missing_docs, reason = "the shader names and describes them")]
pub struct Job {
    pub n: [u32; 3],
    pub order: u32,
    pub h: [f32; 3],
    pub first: u32,
    pub eye: [f32; 4],
    pub inner: u32,
    pub count: u32,
    pub spare: [u32; 2],
}

/// Coefficients of a dispatch.
const COEFFICIENTS: usize = 1 << 24;

/// J of every voxel from the harmonics, which stand before `inner` values of each voxel ([`Towards::contract`]).
pub fn contract(gpu: &Gpu, towards: &Towards, harmonics: &[f32], inner: usize) -> Result<Vec<f32>> {
    contract_by(gpu, towards, harmonics, inner, COEFFICIENTS.min(gpu.binding() as usize / 4))
}

/// The same, by dispatches of `most` coefficients.
fn contract_by(gpu: &Gpu, towards: &Towards, harmonics: &[f32], inner: usize, most: usize) -> Result<Vec<f32>> {
    let k = count(towards.order);
    let per_voxel = k * inner;
    let voxels = (most / per_voxel).max(1);
    let kernel = gpu.kernel(Source::new(["angular", "eye", "harmonics"]))?;
    // All harmonics of one l have the same.
    let moments: Vec<f32> = (0..=towards.order).map(|l| towards.moments[l * l]).collect();
    let eye = match towards.eye {
        LocalEye::Point([x, y, z]) => [x, y, z, 1.0],
        LocalEye::Direction([x, y, z]) => [x, y, z, 0.0],
    };
    let slab = voxels.min(harmonics.len() / per_voxel);
    let (moments, coefficients) = (gpu.buffer(&moments)?, gpu.empty(slab as u64 * per_voxel as u64 * 4)?);
    let (out, job) = (gpu.empty(slab as u64 * inner as u64 * 4)?, gpu.uniform(&Job::zeroed())?);
    let bindings = [
        ("moments", Binding::Buffer(&moments)),
        ("coefficients", Binding::Buffer(&coefficients)),
        ("towards", Binding::Buffer(&out)),
        ("job", Binding::Buffer(&job)),
    ];
    let mut all = Vec::with_capacity(harmonics.len() / k);
    for (at, part) in harmonics.chunks(voxels * per_voxel).enumerate() {
        let count = part.len() / k;
        let first = (at * voxels) as u32;
        gpu.write(&coefficients, 0, part);
        gpu.write(
            &job,
            0,
            &[Job {
                n: towards.n.map(|m| m as u32),
                order: towards.order as u32,
                h: towards.h,
                first,
                eye,
                inner: inner as u32,
                count: count as u32,
                spare: [0; 2],
            }],
        );
        gpu.run(&kernel, &bindings, count as u64)?;
        all.extend(gpu.read::<f32>(&out, count)?);
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::gpu::device::for_tests;
    use crate::physics::Phase;
    use crate::scene::{Albedo, Camera, Medium, Scene, Spectrum, Volume};

    #[test]
    fn harmonics_scatter_towards_the_eye_as_on_the_cpu() {
        let Some(gpu) = for_tests() else { return };
        let n = [5usize, 4, 3];
        let grey = |v: f64| Spectrum::new(&[v], "value").expect("valid");
        let density = vec![1.0f32; 60];
        let volume = Volume::new(&density, n, [0.5, 1.0, 2.0], [0.3, -7.0, 2.0], false).expect("valid");
        let phase = Phase::henyey_greenstein(0.7).expect("valid");
        let medium = Medium::new(volume, grey(2.0), Albedo::Constant(grey(0.9)), phase).expect("valid");
        let up = [0.0, 0.0, 1.0];
        let cameras = [
            Camera::perspective([3.0, -9.0, 5.0], [1.0; 3], up, 30.0, [8, 8]).expect("valid"),
            Camera::orthographic([3.0, -9.0, 5.0], [1.0; 3], up, 4.0, [8, 8]).expect("valid"),
        ];
        let scene = Scene::new(medium, Vec::new(), cameras[0]);
        for camera in &cameras {
            for (order, inner) in [(0, 1), (3, 8), (8, 6)] {
                let towards = Towards::new(&scene, camera, order);
                let size = 60 * count(order) * inner;
                let harmonics: Vec<f32> = (0..size).map(|i| ((i * 7919) % 101) as f32 / 100.0 - 0.4).collect();
                let expected = towards.contract(&harmonics, inner);
                let found = contract_by(&gpu, &towards, &harmonics, inner, 5000).expect("it runs");
                assert_eq!(found.len(), expected.len());
                let top = expected.iter().fold(0.0f32, |m, x| m.max(x.abs()));
                for (a, b) in found.iter().zip(&expected) {
                    assert!((a - b).abs() < 2e-6 * top, "order {order}: {a}, {b}");
                }
            }
        }
    }
}
