//! The majorant grid of null-collision tracking: for each block of voxels a density that is nowhere exceeded in it.

use crate::scene::{Volume, block_maxima};

/// Cubes of `block`^3 voxels, each with the largest density that a lookup within it can return. With interpolation that
/// includes the neighbouring voxels, whose values reach half a voxel into the block.
#[derive(Debug, Clone)]
pub struct MajorantGrid {
    /// Voxels per cell and axis.
    pub block: usize,
    /// Cells along x, y, z.
    pub n: [usize; 3],
    /// Majorant density of each cell, x fastest.
    pub density: Vec<f32>,
}

/// What a cell step and a tentative collision cost, relative to each other (measured in the scalar walk).
const CELL_STEP: f64 = 1.0;
const TENTATIVE: f64 = 3.0;

impl MajorantGrid {
    /// The grid with blocks of the given size.
    pub fn new(volume: &Volume, block: usize) -> Self {
        let n = volume.n().map(|m| m.div_ceil(block));
        MajorantGrid { block, n, density: block_maxima(volume, block, volume.reach()) }
    }

    /// The next coarser grid, of twice the block.
    fn coarser(&self) -> Self {
        let n = self.n.map(|m| m.div_ceil(2));
        let mut density = vec![0.0f32; n[0] * n[1] * n[2]];
        for k in 0..self.n[2] {
            for j in 0..self.n[1] {
                for i in 0..self.n[0] {
                    let cell = &mut density[((k / 2) * n[1] + j / 2) * n[0] + i / 2];
                    *cell = cell.max(self.density[(k * self.n[1] + j) * self.n[0] + i]);
                }
            }
        }
        MajorantGrid { block: self.block * 2, n, density }
    }

    /// Mean number of (cell steps, tentative collisions) per voxel of flight, at `depth` optical depths per voxel and unit
    /// density. An empty cell is crossed voxel by voxel where voxels are scored.
    fn cost(&self, depth: f64) -> f64 {
        let cells = self.density.len() as f64;
        let sum: f64 = self.density.iter().map(|&d| f64::from(d)).sum();
        let steps = 1.5 / self.block as f64;
        CELL_STEP * steps + TENTATIVE * depth * sum / cells
    }

    /// The cheapest block size for the volume, and its expected cost per voxel of flight.
    pub fn cheapest(volume: &Volume, depth: f64) -> (Self, f64) {
        let longest = volume.n().into_iter().max().unwrap_or(1);
        let finest = match volume.voxels() {
            0..=262_144 => 1,
            262_145..=2_097_152 => 2,
            _ => 4,
        };
        let mut grid = MajorantGrid::new(volume, finest);
        let mut best = (grid.clone(), grid.cost(depth));
        while grid.block < longest {
            grid = grid.coarser();
            let cost = grid.cost(depth);
            if cost < best.1 {
                best = (grid.clone(), cost);
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn majorant_includes_the_neighbours_that_interpolation_reads() {
        let mut density = vec![0.0f32; 8 * 4 * 4];
        density[8 * (4 + 1) + 4] = 7.0; // x = 4: first voxel of the second block
        let nearest = Volume::new(&density, [8, 4, 4], [1.0; 3], [0.0; 3], false).expect("valid");
        let linear = Volume::new(&density, [8, 4, 4], [1.0; 3], [0.0; 3], true).expect("valid");
        assert_eq!(MajorantGrid::new(&nearest, 4).density, vec![0.0, 7.0]);
        assert_eq!(MajorantGrid::new(&linear, 4).density, vec![7.0, 7.0]);
        assert_eq!(MajorantGrid::new(&linear, 2).coarser().density, MajorantGrid::new(&linear, 4).density);
    }
}
