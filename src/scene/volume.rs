//! The voxel box: extents, spacing, place, and the density in it.

use crate::error::{Result, scene_error};
use rayon::prelude::*;

/// Densities of `n[0] x n[1] x n[2]` voxels (x fastest) of the size `spacing`, the lower corner at `origin`. Axes in the
/// order x, y, z throughout the crate; Python's (z, y, x) is turned at the border.
#[derive(Debug, Clone, Copy)]
pub struct Volume<'a> {
    density: &'a [f32],
    n: [usize; 3],
    spacing: [f64; 3],
    origin: [f64; 3],
    linear: bool,
    ball: bool,
    min: f32,
    max: f32,
    mean: f64,
}

impl<'a> Volume<'a> {
    /// Validates the densities (finite, not negative; the error counts the bad ones and gives the first index (k, j, i)),
    /// extents (each 1 to 16384) and spacing (finite, positive).
    pub fn new(density: &'a [f32], n: [usize; 3], spacing: [f64; 3], origin: [f64; 3], linear: bool) -> Result<Self> {
        if n.contains(&0) || n.iter().any(|&m| m > 16384) {
            return scene_error(format!(
                "the volume's shape (nz, ny, nx) = ({}, {}, {}) is not allowed; each must be 1 to 16384",
                n[2], n[1], n[0]
            ));
        }
        let voxels = n[0] * n[1] * n[2];
        if density.len() != voxels {
            return scene_error(format!("{} densities were given for {voxels} voxels", density.len()));
        }
        if spacing.iter().any(|h| !(*h >= 1e-12 && *h <= 1e12)) {
            return scene_error(format!(
                "spacing (dz, dy, dx) = ({}, {}, {}) is not allowed; each must be finite and positive (1e-12 to 1e12)",
                spacing[2], spacing[1], spacing[0]
            ));
        }
        let origin = super::finite(origin, "origin")?;
        let bad = |d: &&f32| !(d.is_finite() && **d >= 0.0);
        let (valid, min, max, sum) = survey(density);
        if !valid && let Some(first) = density.iter().position(|d| bad(&d)) {
            let count = density.iter().filter(bad).count();
            let (k, j, i) = (first / (n[0] * n[1]), first / n[0] % n[1], first % n[0]);
            return scene_error(format!(
                "{count} of {voxels} densities are NaN, infinite or negative, the first at index ({k}, {j}, {i}): {}; \
                 densities must be finite, not negative and within float32",
                density[first]
            ));
        }
        Ok(Volume { density, n, spacing, origin, linear, ball: false, min, max, mean: sum / voxels as f64 })
    }

    /// What is known of the volume, with its densities at another place in memory.
    pub fn holding<'b>(&self, density: &'b [f32]) -> Volume<'b> {
        let Volume { n, spacing, origin, linear, ball, min, max, mean, .. } = *self;
        Volume { density, n, spacing, origin, linear, ball, min, max, mean }
    }

    /// The densities, x fastest.
    pub fn density(&self) -> &'a [f32] {
        self.density
    }

    /// Extents along x, y, z.
    pub fn n(&self) -> [usize; 3] {
        self.n
    }

    /// Number of voxels.
    pub fn voxels(&self) -> usize {
        self.density.len()
    }

    /// Voxel size along x, y, z.
    pub fn spacing(&self) -> [f64; 3] {
        self.spacing
    }

    /// The box's size along x, y, z.
    pub fn size(&self) -> [f64; 3] {
        std::array::from_fn(|a| self.n[a] as f64 * self.spacing[a])
    }

    /// The volume of one voxel.
    pub fn voxel_volume(&self) -> f64 {
        self.spacing.iter().product()
    }

    /// The area of the box's surface.
    pub fn surface(&self) -> f64 {
        let s = self.size();
        2.0 * (s[0] * s[1] + s[1] * s[2] + s[2] * s[0])
    }

    /// Whether the density is interpolated between voxel centres.
    pub fn linear(&self) -> bool {
        self.linear
    }

    /// How many voxels beyond its own a lookup reads.
    pub fn reach(&self) -> usize {
        usize::from(self.linear)
    }

    /// The smallest density.
    pub fn min(&self) -> f32 {
        self.min
    }

    /// The largest density.
    pub fn max(&self) -> f32 {
        self.max
    }

    /// The mean density.
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// Whether all voxels hold the same density.
    pub fn is_constant(&self) -> bool {
        self.min == self.max
    }

    /// The ball that fits into a cube of one voxel, in place of it.
    pub fn ball(self) -> Result<Self> {
        let h = self.spacing;
        if self.n != [1; 3] || h[0] != h[1] || h[1] != h[2] {
            return scene_error("a ball is made of a cube of one voxel");
        }
        Ok(Volume { ball: true, ..self })
    }

    /// Whether the medium fills the ball in the cube only.
    pub fn is_ball(&self) -> bool {
        self.ball
    }

    /// The world's coordinates of a point given relative to the box's lower corner.
    pub fn world(&self, local: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| local[a] + self.origin[a])
    }

    /// A world point relative to the lower corner.
    pub fn local(&self, world: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| world[a] - self.origin[a])
    }
}

/// Whether all densities are valid, the smallest, the largest, and their sum, which does not depend on the threads.
fn survey(density: &[f32]) -> (bool, f32, f32, f64) {
    let parts: Vec<_> = density
        .par_chunks(1 << 16)
        .map(|part| {
            part.iter().fold((true, f32::INFINITY, 0.0f32, 0.0f64), |(valid, min, max, sum), &d| {
                (valid & d.is_finite() & (d >= 0.0), min.min(d), max.max(d), sum + f64::from(d))
            })
        })
        .collect();
    parts.into_iter().reduce(|a, b| (a.0 && b.0, a.1.min(b.1), a.2.max(b.2), a.3 + b.3)).unwrap_or((
        true,
        f32::INFINITY,
        0.0,
        0.0,
    ))
}
