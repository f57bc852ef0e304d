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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::Phase;
    use crate::physics::harmonics::{MAX_ORDER, gauss_legendre, legendre};
    use crate::scene::{Albedo, Camera, Medium, Spectrum, Volume};
    use std::f64::consts::{PI, TAU};

    /// Directions and solid angles, exact for polynomials of degree 2 MAX_ORDER + 1 and more.
    fn sphere() -> impl Iterator<Item = ([f64; 3], f64)> {
        const N: usize = 2 * MAX_ORDER;
        gauss_legendre(N).flat_map(|(z, w)| {
            (0..2 * N).map(move |i| {
                let (sin, cos) = (PI * i as f64 / N as f64).sin_cos();
                let s = (1.0 - z * z).sqrt();
                ([s * cos, s * sin, z], w * TAU / (2 * N) as f64)
            })
        })
    }

    #[test]
    fn contraction_is_the_integral_of_radiance_and_phase_function() {
        let n = [3, 2, 2];
        let (voxels, h) = ([1.0f32; 12], [1.0, 1.5, 0.7]);
        let volume = Volume::new(&voxels, n, h, [0.0; 3], false).expect("valid");
        let camera = Camera::perspective([7.0, -6.0, 9.0], [1.5; 3], [0.0, 0.0, 1.0], 30.0, [4, 4]).expect("valid");
        let grey = |value: f64| Spectrum::new(&[value], "value").expect("valid");
        let phase = Phase::henyey_greenstein(-0.8).expect("valid");
        let medium = Medium::new(volume, grey(1.0), Albedo::Constant(grey(0.5)), phase.clone()).expect("valid");
        let scene = Scene::new(medium, Vec::new(), camera);
        let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| a[i] * b[i]).sum::<f64>();
        for order in 0..=MAX_ORDER {
            // (1/2 + a . d)^order is a sum of harmonics of that order and below: of such light nothing is left out.
            let axis = [0.48, -0.6, 0.64];
            let radiance = |d: [f64; 3]| (0.5 + dot(axis, d)).powi(order as i32);
            let mut harmonics = vec![0.0f64; count(order)];
            let mut y = vec![0.0f64; count(order)];
            for (d, w) in sphere() {
                evaluate(d, order, &mut y);
                harmonics.iter_mut().zip(&y).for_each(|(sum, y)| *sum += w * radiance(d) * y);
            }
            let all: Vec<f64> =
                (0..12).flat_map(|voxel| harmonics.iter().map(move |x| x * f64::from(voxel + 1))).collect();
            let towards = Towards::new(&scene, &camera, order);
            let found = towards.contract_part(0, &all, 1);
            let single: Vec<f32> = all.iter().map(|&x| x as f32).collect();
            for (voxel, (found, other)) in found.iter().zip(towards.contract(&single, 1)).enumerate() {
                let centre = [voxel % 3, voxel / 3 % 2, voxel / 6];
                let to: [f64; 3] = std::array::from_fn(|a| [7.0, -6.0, 9.0][a] - (centre[a] as f64 + 0.5) * h[a]);
                let length = dot(to, to).sqrt();
                // Of the phase function what such light sees: P = sum of (2l + 1) / (4 pi) p_l P_l.
                let p = |cosine: f64| {
                    let term = |l: usize| (2 * l + 1) as f64 * phase.legendre(l) * legendre(l, cosine);
                    (0..=order).map(term).sum::<f64>() / (4.0 * PI)
                };
                let truth: f64 = sphere().map(|(d, w)| w * radiance(d) * p(dot(d, to) / length)).sum();
                let truth = truth * (voxel + 1) as f64;
                assert!(
                    (found - truth).abs() < 1e-5 * truth.abs().max(0.01),
                    "{order} {voxel}: {found} and not {truth}"
                );
                assert!((f64::from(other) - truth).abs() < 1e-5 * truth.abs().max(0.01));
            }
        }
    }
}
