//! Sums of 64 bits in fixed point, to which threads add in any order with the same result.

use super::aim::Source;
use crate::error::{Error, Result};
use crate::plan::cost::PRIVATE_SUMS;
use crate::scene::Volume;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering::Relaxed};

/// Bits of what a voxel holds in vacuum, at most.
pub const WHOLE: i64 = 58;

/// Sums of voxels.
pub struct Sums {
    sets: Vec<Vec<AtomicI64>>,
    /// Whether several threads add to one set.
    shared: bool,
    overflow: AtomicBool,
}

/// The set that a thread adds to.
#[derive(Clone, Copy)]
pub struct Set<'a> {
    sums: &'a [AtomicI64],
    shared: bool,
    overflow: &'a AtomicBool,
}

impl Set<'_> {
    /// Adds some units, rounded.
    #[inline(always)]
    pub fn add(&self, at: usize, units: f64) {
        let units = (units + if units < 0.0 { -0.5 } else { 0.5 }) as i64;
        let sum = &self.sums[at];
        let old = if self.shared {
            sum.fetch_add(units, Relaxed)
        } else {
            let old = sum.load(Relaxed);
            sum.store(old.wrapping_add(units), Relaxed);
            old
        };
        if old.checked_add(units).is_none() {
            self.overflow.store(true, Relaxed);
        }
    }
}

impl Sums {
    /// `len` sums that are zero, of `tallies` such lists.
    pub fn new(len: usize, tallies: usize) -> Self {
        let threads = rayon::current_num_threads();
        let sets = if len * tallies * threads * 8 <= PRIVATE_SUMS { threads } else { 1 };
        let set = || {
            let mut set = Vec::new();
            set.resize_with(len, AtomicI64::default);
            set
        };
        let shared = sets == 1 && threads > 1;
        Sums { sets: (0..sets).map(|_| set()).collect(), shared, overflow: AtomicBool::new(false) }
    }

    /// That of this thread.
    pub fn set(&self) -> Set<'_> {
        let own = rayon::current_thread_index().unwrap_or(0) % self.sets.len();
        Set { sums: &self.sets[own], shared: self.shared, overflow: &self.overflow }
    }

    /// Takes the sums from `first` on, and leaves zeros.
    pub fn take(&self, first: usize, into: &mut [f64]) {
        let take = |sum: &AtomicI64| {
            let units = sum.load(Relaxed);
            sum.store(0, Relaxed);
            units
        };
        into.iter_mut().enumerate().for_each(|(at, into)| {
            *into = self.sets.iter().map(|set| take(&set[first + at])).sum::<i64>() as f64;
        });
    }

    /// An error if a sum overflowed.
    pub fn check(&self) -> Result<()> {
        if self.overflow.load(Relaxed) {
            return Err(Error::Internal("a sum of unscattered light overflowed".into()));
        }
        Ok(())
    }
}

/// Units per mean fluence of a light of value 1: a power of 2 by voxel, from a bound on its fluence in vacuum.
pub struct Units {
    /// Of a point light the squares of the least distances from it along each axis, by layer of voxels.
    distance2: Option<[Vec<f64>; 3]>,
    /// The square of the distance below which a voxel receives no more.
    near: f64,
}

impl Units {
    /// Those of a light.
    pub fn new(volume: &Volume, source: Source) -> Self {
        let (n, h) = (volume.n(), volume.spacing());
        let diagonal = h.iter().map(|h| h * h).sum::<f64>().sqrt();
        let distance2 = match source {
            Source::Parallel(_) => None,
            Source::Point(p) => {
                let least = |a: usize, at: usize| ((at as f64 + 0.5 - p[a]).abs() - 0.5).max(0.0) * h[a];
                Some(std::array::from_fn(|a| (0..n[a]).map(|at| least(a, at).powi(2)).collect()))
            }
        };
        Units { distance2, near: volume.voxel_volume() / (4.0 * std::f64::consts::PI * diagonal) }
    }

    /// What a sum of 2^[`WHOLE`] units stands for in a voxel.
    pub fn size(&self, cell: [usize; 3]) -> f64 {
        power_of_2(WHOLE) / self.of(cell.map(|c| c as i32))
    }

    /// Those of a voxel.
    #[inline(always)]
    pub fn of(&self, cell: [i32; 3]) -> f64 {
        match &self.distance2 {
            None => power_of_2(WHOLE),
            // 1 / distance^2 is at most 2^-exponent.
            Some([x, y, z]) => {
                let distance2 = x[cell[0] as usize] + y[cell[1] as usize] + z[cell[2] as usize];
                power_of_2(WHOLE + exponent(distance2.max(self.near)))
            }
        }
    }
}

/// The largest power of 2 not above a positive number, as its exponent.
#[inline(always)]
pub fn exponent(x: f64) -> i64 {
    (x.to_bits() >> 52) as i64 - 1023
}

/// 2 to an exponent within that of doubles.
#[inline(always)]
pub fn power_of_2(exponent: i64) -> f64 {
    f64::from_bits(((exponent + 1023).clamp(1, 2046) as u64) << 52)
}
