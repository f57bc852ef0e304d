//! Where a medium that emits does so: voxels are drawn by their emission.

use crate::scene::environment::{per_mean, weights};
use crate::scene::field::{Field, V3};
use rayon::prelude::*;

/// An emitting medium, whose voxels are drawn by what they emit in all channels together, each over its mean.
pub(in crate::backend) struct Glowing<'a> {
    pub(in crate::backend) fields: Vec<Field<'a>>,
    /// What makes each field's mean 1; 0 where it is dark.
    pub(in crate::backend) factors: [f32; 3],
    /// Sums of the voxels' values up to the end of each row along x.
    pub(in crate::backend) rows: Vec<f64>,
    n: [usize; 2],
}

impl<'a> Glowing<'a> {
    pub fn new(fields: Vec<Field<'a>>, means: [f64; 3]) -> Self {
        let n = fields[0].n().map(|m| m as usize);
        let factors = per_mean(&means[..fields.len()]);
        let mut rows: Vec<f64> = (0..n[1] * n[2])
            .into_par_iter()
            .map(|row| (row * n[0]..(row + 1) * n[0]).map(|at| sum_of(&fields, &factors, at)).sum())
            .collect();
        let mut total = 0.0;
        for row in &mut rows {
            total += *row;
            *row = total;
        }
        Glowing { fields, factors, rows, n: [n[0], n[1]] }
    }

    /// The voxel at the part `u` of all emission.
    pub fn find(&self, u: f64) -> [usize; 3] {
        let target = u * self.rows[self.rows.len() - 1];
        let row = self.rows.partition_point(|&sum| sum <= target).min(self.rows.len() - 1);
        let mut rest = target - if row > 0 { self.rows[row - 1] } else { 0.0 };
        let [nx, ny] = self.n;
        // Rounding may run over the end of the row: then the last voxel that emits.
        let mut found = 0;
        for i in 0..nx {
            let value = sum_of(&self.fields, &self.factors, row * nx + i);
            if value > 0.0 {
                found = i;
                if rest < value {
                    break;
                }
                rest -= value;
            }
        }
        [found, row % ny, row / ny]
    }

    /// A place of a voxel's light, from six uniform numbers: uniform over it, or distributed as its hat of interpolation, the
    /// sum of two uniform numbers, which is folded back at the box's faces (where values are clamped).
    pub fn place(&self, voxel: [usize; 3], xi: [f64; 6]) -> [f64; 3] {
        let n = self.fields[0].n();
        std::array::from_fn(|a| {
            let low = voxel[a] as f64;
            if !self.fields[0].linear() {
                return low + xi[a];
            }
            let p = (low + xi[a] + xi[a + 3] - 0.5).abs();
            let top = f64::from(n[a]);
            if p > top { 2.0 * top - p } else { p }
        })
    }

    /// The weight of each channel at a point.
    pub fn colour(&self, p: V3) -> [f32; 3] {
        let values = std::array::from_fn(|c| self.fields[c % self.fields.len()].at(p));
        weights(values, self.factors)
    }
}

/// The sum of some fields in a voxel, each times its factor.
#[inline(always)]
pub(in crate::backend) fn sum_of(fields: &[Field], factors: &[f32; 3], at: usize) -> f64 {
    fields.iter().zip(factors).map(|(field, &factor)| f64::from(field.values()[at] * factor)).sum()
}
