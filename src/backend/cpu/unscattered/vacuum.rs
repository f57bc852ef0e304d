//! A control variate for the rays of a point light: in a vacuum the mean fluence of each voxel is known, so rays need to find
//! only by how much less of it there is.
//!
//! With `L` the length of a ray's way in a voxel and `X` what it leaves there, a lattice estimates `E[X - s L] + s E[L]`,
//! which is `E[X]` for whatever share `s` other rays have found. Where a voxel is thin, `X` is nearly `s L`, and hardly any
//! noise is left.

use super::aim::{Aim, Source};
use super::tally::Sums;
use crate::scene::Volume;
use crate::tally::Moments;
use rayon::prelude::*;

/// Diagonals of a voxel within which its mean fluence is not taken as known.
const NEAR: f64 = 4.0;

/// The shares of the vacuum's fluence that remain.
pub struct Vacuum {
    light: [f64; 3],
    n: [usize; 3],
    h: [f64; 3],
    /// By tally, of each voxel and extinction.
    shares: [Option<Vec<f32>>; 3],
}

impl Vacuum {
    /// The shares that rays found, each tally in units of a scale, of which `lengths` says how long their ways were; `None` if
    /// the light is no point.
    pub fn new<const K: usize>(
        volume: &Volume,
        aim: &Aim,
        (sums, scales): (&[Option<Sums>; 3], [f64; 3]),
        lengths: &Sums,
    ) -> Option<Self> {
        let Source::Point(light) = aim.source else { return None };
        let (n, voxels) = (volume.n(), volume.voxels());
        let mut vacuum = Vacuum { light, n, h: volume.spacing(), shares: [None, None, None] };
        let mut ways = vec![0.0; voxels];
        lengths.take(0, &mut ways);
        let shares = |(sums, scale): (&Sums, f64)| {
            let mut shares = vec![f32::NAN; voxels * K];
            shares.par_chunks_mut(K).zip(&ways).enumerate().for_each(|(voxel, (shares, way))| {
                let mut found = [0.0; K];
                sums.take(voxel * K, &mut found);
                if vacuum.mean(voxel).is_none() {
                    shares.fill(0.0);
                } else if *way > 0.0 {
                    (0..K).for_each(|c| shares[c] = (found[c] / (way * scale)) as f32);
                }
            });
            let shares = neighbours(neighbours(shares, n, K), n, K);
            shares.into_iter().map(|share| if share.is_nan() { 0.0 } else { share }).collect()
        };
        let found = [0, 1, 2].map(|tally| sums[tally].as_ref().map(|sums| shares((sums, scales[tally]))));
        vacuum.shares = found;
        Some(vacuum)
    }

    /// The mean of 1 / distance^2 over a voxel, to 3e-5: by its second derivatives. `None` near the light.
    fn mean(&self, voxel: usize) -> Option<f64> {
        let [nx, ny, _] = self.n;
        let cell = [voxel % nx, voxel / nx % ny, voxel / (nx * ny)];
        let r2: [f64; 3] = std::array::from_fn(|a| ((cell[a] as f64 + 0.5 - self.light[a]) * self.h[a]).powi(2));
        let h2 = self.h.map(|h| h * h);
        let d2: f64 = r2.iter().sum();
        if d2 < NEAR * NEAR * h2.iter().sum::<f64>() {
            return None;
        }
        let bend: f64 = (0..3).map(|a| h2[a] * (4.0 * r2[a] / d2 - 1.0)).sum();
        Some((1.0 + bend / (12.0 * d2)) / d2)
    }

    /// The share of a tally.
    #[inline(always)]
    pub fn share(&self, tally: usize, at: usize) -> f64 {
        self.shares[tally].as_ref().map_or(0.0, |shares| f64::from(shares[at]))
    }

    /// Adds what is known to the moments of the rest, in units that `unit(voxel)` tells. Where nothing was counted of the rest
    /// no ray has met the voxel, which may as well hold nothing, unless it holds all or nothing anyhow.
    pub fn add(&self, tally: usize, moments: &mut Moments, count: u64, unit: impl Fn(usize) -> f64 + Sync) {
        let Some(shares) = &self.shares[tally] else { return };
        let k = shares.len() / self.n.iter().product::<usize>();
        let values = moments.mean.par_chunks_mut(k).zip(moments.m2.par_chunks_mut(k)).zip(shares.par_chunks(k));
        values.enumerate().for_each(|(voxel, ((mean, m2), shares))| {
            let Some(whole) = self.mean(voxel) else { return };
            for c in 0..k {
                let known = f64::from(shares[c]) * whole / unit(voxel);
                if mean[c] == 0.0 && m2[c] == 0.0 && shares[c] != 1.0 {
                    m2[c] = (known * known * (count * (count - 1)) as f64) as f32;
                }
                mean[c] += known;
            }
        });
    }
}

/// Gives voxels without a value the mean of those around that have one.
fn neighbours(values: Vec<f32>, [nx, ny, nz]: [usize; 3], k: usize) -> Vec<f32> {
    let around = |at: usize, n: usize| at.saturating_sub(1)..(at + 2).min(n);
    let filled = (0..values.len()).into_par_iter().map(|at| {
        if !values[at].is_nan() {
            return values[at];
        }
        let (voxel, c) = (at / k, at % k);
        let (mut sum, mut count) = (0.0, 0.0);
        for z in around(voxel / (nx * ny), nz) {
            for y in around(voxel / nx % ny, ny) {
                for x in around(voxel % nx, nx) {
                    let value = values[((z * ny + y) * nx + x) * k + c];
                    if !value.is_nan() {
                        sum += value;
                        count += 1.0;
                    }
                }
            }
        }
        if count > 0.0 { sum / count } else { f32::NAN }
    });
    filled.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_of_a_voxel_is_its_quadrature() {
        let vacuum =
            Vacuum { light: [-2.0, 30.0, 11.0], n: [20, 10, 10], h: [1.0, 0.5, 2.0], shares: [None, None, None] };
        let mut known = 0;
        for voxel in 0..2000 {
            let Some(mean) = vacuum.mean(voxel) else { continue };
            let cell = [voxel % 20, voxel / 20 % 10, voxel / 200];
            let m = 12;
            let mut sum = 0.0;
            for i in 0..m * m * m {
                let at = [i % m, i / m % m, i / (m * m)];
                let d2: f64 = (0..3)
                    .map(|a| cell[a] as f64 + (at[a] as f64 + 0.5) / m as f64 - vacuum.light[a])
                    .zip(vacuum.h)
                    .map(|(d, h)| (d * h).powi(2))
                    .sum();
                sum += 1.0 / d2;
            }
            // The midpoint rule errs by 1 / 144 of what the second derivatives add.
            let true_mean = sum / (m * m * m) as f64;
            assert!((mean / true_mean - 1.0).abs() < 3e-4, "{cell:?}: {mean} {true_mean}");
            known += 1;
        }
        assert!(known > 1000, "{known}");
    }
}
