//! The majorant grid of null-collision tracking: for each block of voxels a density that is nowhere exceeded in it.

use super::Settings;
use crate::scene::{Scene, Volume, block_maxima};

/// Voxels' scores at tentative collisions need a majorant of this optical depth per voxel: with rarer ones their spread
/// is so skew that a standard error does not describe it.
pub const LEAST_SCORED_DEPTH: f64 = 0.3;

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

/// What the steps of a null-collision flight cost, relative to each other (measured).
#[derive(Debug, Clone, Copy)]
pub struct StepCosts {
    /// Crossing a cell of the grid.
    pub cell: f64,
    /// A tentative collision.
    pub tentative: f64,
    /// Optical depth per voxel that the majorant has at least, for the sake of its scores.
    pub least: f64,
}

impl StepCosts {
    /// In the walk of one photon after the other.
    pub const SCALAR: StepCosts = StepCosts { cell: 1.0, tentative: 3.0, least: 0.0 };
    /// In lanes.
    pub const LANES: StepCosts = StepCosts { cell: 1.0, tentative: 1.0, least: 0.0 };
}

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

    /// Whether one majorant bounds the whole volume.
    pub fn is_one(&self) -> bool {
        self.density.len() == 1
    }

    /// Mean cost per voxel of flight, at `depth` optical depths per voxel and unit density. A single cell is not crossed.
    fn cost(&self, depth: f64, costs: StepCosts) -> f64 {
        let cells = self.density.len() as f64;
        let sum: f64 = self.density.iter().map(|&d| (depth * f64::from(d)).max(costs.least)).sum();
        let steps = if self.is_one() { 0.0 } else { 1.5 / self.block as f64 };
        costs.cell * steps + costs.tentative * sum / cells
    }

    /// The cheapest block size for the volume, and its expected cost per voxel of flight.
    pub fn cheapest(volume: &Volume, depth: f64, costs: StepCosts) -> (Self, f64) {
        let longest = volume.n().into_iter().max().unwrap_or(1);
        let finest = match volume.voxels() {
            0..=262_144 => 1,
            262_145..=2_097_152 => 2,
            _ => 4,
        };
        let mut grid = MajorantGrid::new(volume, finest);
        let mut best = (grid.clone(), grid.cost(depth, costs));
        while grid.block < longest {
            grid = grid.coarser();
            let cost = grid.cost(depth, costs);
            if cost < best.1 {
                best = (grid.clone(), cost);
            }
        }
        best
    }
}

/// With so many scores in the mean voxel the mean of z^2 is right within 2 %, however rare they are beside the photons that
/// cross it.
const ENOUGH_SCORES: f64 = 100.0;

/// So many scores cost less than a photon's start and end.
const CHEAP_SCORES: f64 = 2.0;

/// The optical depth per voxel that the majorant of a homogeneous medium has at least for the sake of the voxels' scores,
/// where photons are walked one by one; `None` if the medium is another, or a void. The steps of a photon do not grow with
/// the number of voxels, as they would along its track, unless voxels have scores too few to tell their errors.
pub(super) fn least_scored_depth(scene: &Scene, settings: &Settings, orders: u32) -> Option<f64> {
    let medium = &scene.medium;
    let volume = &medium.volume;
    if !volume.is_constant() || medium.max_sigma_t() == 0.0 {
        return None;
    }
    let Some(photons) = settings.photons else { return Some(LEAST_SCORED_DEPTH) };
    // The way of a photon in the box: its mean chord, unless absorption or the highest order end it before.
    let chord = 4.0 * volume.size().iter().product::<f64>() / volume.surface();
    let ends = (1.0 - medium.max_albedo()).max(1.0 / (f64::from(orders) + 1.0));
    let way = chord / (1.0 + ends * medium.max_sigma_t() * chord);
    let h = volume.spacing().into_iter().fold(f64::INFINITY, f64::min);
    let scores = CHEAP_SCORES.max(ENOUGH_SCORES * volume.voxels() as f64 / photons as f64);
    Some((scores / way * h).min(LEAST_SCORED_DEPTH))
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
