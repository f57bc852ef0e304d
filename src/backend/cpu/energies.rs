//! Where the energy of photons goes, in fixed point: sums are the same in any order.

use crate::error::{Error, Result};
use crate::result::Share;
use crate::tally::rounded;

/// Fixed-point unit of energies: weights of 1 are 2^36 units. Those of a batch, whose mean is 1 at the start, stay far
/// within 63 bits: [`crate::plan::LARGEST_BATCH`].
const ENERGY_UNIT: f32 = 68_719_476_736.0;
/// What happened to the energy of the photons of a task or batch, in fixed point: sums are the same in any order.
#[derive(Debug, Clone, Copy)]
pub struct Energies {
    shares: [[i64; 3]; Share::COUNT],
    /// Whether a sum left the range of its integer.
    overflowed: bool,
    /// Real collisions.
    pub collisions: u64,
}

impl Default for Energies {
    fn default() -> Self {
        Energies { shares: [[0; 3]; Share::COUNT], overflowed: false, collisions: 0 }
    }
}

impl Energies {
    /// Sums of shares by channel in 2^-36 of a weight, and real collisions.
    pub fn from_units(shares: [[i64; 3]; Share::COUNT], collisions: u64) -> Self {
        Energies { shares, overflowed: false, collisions }
    }

    /// Adds a weight to a share; `xi` rounds.
    #[inline(always)]
    pub fn add<const C: usize>(&mut self, share: Share, weight: [f32; C], xi: f32) {
        for c in 0..C {
            self.add_units(share.index(), c, rounded(weight[c] * ENERGY_UNIT, xi));
        }
    }

    #[inline(always)]
    fn add_units(&mut self, share: usize, channel: usize, units: i64) {
        let (sum, overflowed) = self.shares[share][channel].overflowing_add(units);
        self.shares[share][channel] = sum;
        self.overflowed |= overflowed;
    }

    /// The sums of both.
    pub fn merge(mut self, other: Self) -> Self {
        for share in 0..Share::COUNT {
            for channel in 0..3 {
                self.add_units(share, channel, other.shares[share][channel]);
            }
        }
        self.overflowed |= other.overflowed;
        self.collisions += other.collisions;
        self
    }

    /// Itself, or an error where a sum ever left its range.
    pub fn checked(self) -> Result<Self> {
        if self.overflowed {
            return Err(Error::Internal("the energies of a batch exceeded 2^63 units".into()));
        }
        Ok(self)
    }

    /// The sum in a share and channel, in weights.
    pub fn get(&self, share: Share, channel: usize) -> f64 {
        self.shares[share.index()][channel] as f64 / f64::from(ENERGY_UNIT)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::rng::{rounding, words};

    #[test]
    fn energies_that_leave_their_range_are_an_error() {
        let near = |units: i64| Energies::from_units([[units; 3]; Share::COUNT], 0);
        let mut fits = near(i64::MAX - (1 << 37));
        fits.add(Share::Absorbed, [1.0f32], 0.5);
        assert!(fits.checked().is_ok());
        fits.add(Share::Absorbed, [2.0f32], 0.5);
        assert!(fits.checked().is_err_and(|e| e.to_string().contains("2^63")));
        assert!(near(1 << 62).merge(near(1 << 62)).checked().is_err());
        assert!(near(1 << 61).merge(near(1 << 61)).checked().is_ok());
        assert!(near(-1 << 62).merge(near(-1 << 62)).merge(near(-1)).checked().is_err());
        // What is not finite is no energy.
        let mut infinite = near(1);
        infinite.add(Share::Absorbed, [f32::INFINITY], 0.5);
        assert!(infinite.checked().is_err());
    }

    #[test]
    fn small_energies_keep_their_mean() {
        let mut sum = Energies::default();
        let n = 1 << 20;
        for i in 0..n {
            let xi = rounding(words([1, 0], [i, 0], 0, 0)[0]);
            // A hundredth of a unit, up and down.
            sum.add(Share::Absorbed, [0.01 / ENERGY_UNIT, -0.01 / ENERGY_UNIT], xi);
        }
        for (channel, sign) in [(0, 1.0), (1, -1.0)] {
            let units = sum.get(Share::Absorbed, channel) * f64::from(ENERGY_UNIT) * sign;
            let (mean, error) = (0.01 * f64::from(n), (0.01 * f64::from(n)).sqrt());
            // 1 in 10^7.
            assert!((units - mean).abs() < 5.3 * error, "{units} of {mean}");
        }
    }
}
