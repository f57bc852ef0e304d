//! From spherical harmonics of the incident radiance to what scatters towards an eye: J = sum of p_l L_lm Y_lm(to the eye),
//! as `physics::harmonics` derives it.

use crate::physics::harmonics::{count, evaluate};
use crate::scene::eye::LocalEye;
use crate::scene::{Camera, Scene};
use rayon::prelude::*;

/// The weights p_l Y_lm(to the eye) of a voxel's harmonics.
pub struct Towards {
    pub(crate) order: usize,
    /// p_l of each harmonic.
    pub(crate) moments: Vec<f32>,
    pub(crate) eye: LocalEye,
    pub(crate) h: [f32; 3],
    pub(crate) n: [usize; 3],
}

impl Towards {
    /// For the eye of a camera.
    pub fn new(scene: &Scene, camera: &Camera, order: usize) -> Self {
        let volume = &scene.medium.volume;
        let moment = |k: usize| scene.medium.phase.legendre(k.isqrt()) as f32;
        Towards {
            order,
            moments: (0..count(order)).map(moment).collect(),
            eye: LocalEye::new(scene, camera),
            h: volume.spacing().map(|c| c as f32),
            n: volume.n(),
        }
    }

    /// The weights of a voxel.
    #[inline]
    pub fn weights(&self, voxel: usize, out: &mut [f32]) {
        let [nx, ny, _] = self.n;
        let centre = [voxel % nx, voxel / nx % ny, voxel / (nx * ny)].map(|c| c as f32 + 0.5);
        evaluate(self.eye.from(centre, self.h), self.order, out);
        out.iter_mut().zip(&self.moments).for_each(|(y, p)| *y *= p);
    }

    /// J of the voxels from `first` on, in double precision.
    pub fn contract_part(&self, first: usize, harmonics: &[f64], inner: usize) -> Vec<f64> {
        let k = count(self.order);
        let mut out = vec![0.0f64; harmonics.len() / k];
        let mut weights = vec![0.0f32; k];
        for (at, (out, harmonics)) in out.chunks_mut(inner).zip(harmonics.chunks(inner * k)).enumerate() {
            self.weights(first + at, &mut weights);
            for (weight, values) in weights.iter().zip(harmonics.chunks(inner)) {
                out.iter_mut().zip(values).for_each(|(sum, x)| *sum += f64::from(*weight) * x);
            }
        }
        out
    }

    /// J of every voxel from the harmonics, which stand before `inner` values of each voxel (channels, replicates).
    pub fn contract(&self, harmonics: &[f32], inner: usize) -> Vec<f32> {
        let k = count(self.order);
        let mut out = vec![0.0f32; harmonics.len() / k];
        out.par_chunks_mut(inner).zip(harmonics.par_chunks(inner * k)).enumerate().for_each_init(
            || vec![0.0f32; k],
            |weights, (voxel, (out, harmonics))| {
                self.weights(voxel, weights);
                for (weight, values) in weights.iter().zip(harmonics.chunks(inner)) {
                    out.iter_mut().zip(values).for_each(|(sum, x)| *sum += weight * x);
                }
            },
        );
        out
    }
}
