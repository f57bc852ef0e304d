//! Which parts of a volume hold anything.

use crate::scene::{Volume, block_maxima};

/// Blocks of voxels, each with whether a lookup within it can be other than zero.
#[derive(Debug, Clone)]
pub struct Occupancy {
    pub(super) n: [i32; 3],
    pub(super) occupied: Vec<bool>,
}

/// Voxels per block of [`Occupancy`] and axis.
pub const BLOCK: usize = 8;

impl Occupancy {
    /// The occupied blocks of a volume; `None` where skipping the empty ones would not pay.
    pub fn new(volume: &Volume) -> Option<Self> {
        let grid = block_maxima(volume, BLOCK, volume.reach());
        let empty = grid.iter().filter(|&&d| d == 0.0).count();
        (8 * empty >= grid.len()).then(|| Occupancy {
            n: volume.n().map(|m| m.div_ceil(BLOCK) as i32),
            occupied: grid.iter().map(|&d| d > 0.0).collect(),
        })
    }

    /// Whether each block is occupied, x fastest.
    pub fn blocks(&self) -> &[bool] {
        &self.occupied
    }

    /// Whether the voxel (i, j, k) may matter to a lookup.
    #[inline(always)]
    pub fn voxel(&self, c: [usize; 3]) -> bool {
        self.at(c.map(|x| (x / BLOCK) as i32))
    }

    #[inline(always)]
    pub(super) fn at(&self, c: [i32; 3]) -> bool {
        self.occupied[((c[2] * self.n[1] + c[1]) * self.n[0] + c[0]) as usize]
    }
}
