//! Fixed-point tallies: bins that threads add to in any order with the same bits, and the moments that batches fold into.

use rayon::prelude::*;
use std::sync::Mutex;
use std::sync::atomic::{AtomicI32, Ordering::Relaxed};

/// A deposit of the reference size in units of a bin. Deposits are rounded stochastically, so none rounds away.
pub const REFERENCE_UNITS: f64 = 65_536.0;

/// One batch's deposits: signed 32-bit words, and the carries out of them. One set per thread, whose additions then need no
/// locked instruction, or one that all threads share.
#[derive(Debug)]
pub struct Bins {
    words: Vec<AtomicI32>,
    shared: bool,
    carries: Mutex<Vec<(usize, i32)>>,
}

impl Bins {
    /// `len` empty bins, which several threads may add to if `shared`.
    pub fn new(len: usize, shared: bool) -> Self {
        let mut words = Vec::new();
        words.resize_with(len, AtomicI32::default);
        Bins { words, shared, carries: Mutex::default() }
    }

    /// Adds `value` (in units), [`rounded`].
    #[inline(always)]
    pub fn add(&self, index: usize, value: f32, xi: f32) {
        if value.abs() < 2_147_483_648.0 {
            let whole = value as i32;
            let rest = value - whole as f32;
            let away = i32::from(xi < rest.abs());
            self.add_word(index, whole + if rest < 0.0 { -away } else { away });
        } else {
            self.add_large(index, value as i64);
        }
    }

    /// Adds whole units.
    #[inline(always)]
    pub fn add_word(&self, index: usize, increment: i32) {
        let word = &self.words[index];
        let old = if self.shared {
            word.fetch_add(increment, Relaxed)
        } else {
            let old = word.load(Relaxed);
            word.store(old.wrapping_add(increment), Relaxed);
            old
        };
        if old.checked_add(increment).is_none() {
            self.carry(index, increment.signum());
        }
    }

    #[cold]
    fn add_large(&self, index: usize, increment: i64) {
        let low = increment as i32;
        self.add_word(index, low);
        self.carry(index, ((increment - i64::from(low)) >> 32) as i32);
    }

    #[cold]
    fn carry(&self, index: usize, count: i32) {
        if let Ok(mut carries) = self.carries.lock() {
            carries.push((index, count));
        }
    }

    /// Their number.
    pub fn len(&self) -> usize {
        self.words.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    /// Takes in sums of 64 bits (two's complement), as lower and upper words.
    pub fn load(&mut self, low: &[u32], high: &[u32]) {
        let mut carries = Vec::new();
        for (at, ((word, &low), &high)) in self.words.iter_mut().zip(low).zip(high).enumerate() {
            *word.get_mut() = low as i32;
            // The lower word has a sign here.
            let carry = (high as i32).wrapping_add(i32::from((low as i32) < 0));
            if carry != 0 {
                carries.push((at, carry));
            }
        }
        if let Ok(list) = self.carries.get_mut() {
            *list = carries;
        }
    }

    /// Ends a batch: blocks of the bins to be [`Block::drain`]ed, `size` each.
    pub fn blocks(&mut self, size: usize) -> Vec<Block<'_>> {
        let mut carries = self.carries.get_mut().map(std::mem::take).unwrap_or_default();
        carries.sort_unstable_by_key(|c| c.0);
        let mut blocks = Vec::with_capacity(self.words.len().div_ceil(size));
        let mut rest = carries.into_iter().peekable();
        for (at, words) in self.words.chunks_mut(size).enumerate() {
            let first = at * size;
            let mut mine = Vec::new();
            while let Some((index, count)) = rest.next_if(|c| c.0 < first + words.len()) {
                mine.push((index - first, count));
            }
            blocks.push(Block { words, carries: mine });
        }
        blocks
    }
}

/// `value` as a whole number: rounded away from zero with the chance of its fraction, where that is above `xi`, uniform
/// within (0, 1]. Neither the value nor its fraction is changed before they are compared, so that the mean is right to
/// half the step of `xi`, however small the value.
#[inline(always)]
pub fn rounded(value: f32, xi: f32) -> i64 {
    let whole = value as i64;
    let rest = value - whole as f32;
    let away = i64::from(xi < rest.abs());
    whole.saturating_add(if rest < 0.0 { -away } else { away })
}

/// A part of the bins whose batch is over.
#[derive(Debug)]
pub struct Block<'a> {
    words: &'a mut [AtomicI32],
    carries: Vec<(usize, i32)>,
}

impl Block<'_> {
    /// Adds the bins' units to `sums` and leaves them empty; false if they were.
    pub fn drain(&mut self, sums: &mut [f64]) -> bool {
        if self.carries.is_empty() && self.words.iter_mut().fold(0, |any, word| any | *word.get_mut()) == 0 {
            return false;
        }
        for (sum, word) in sums.iter_mut().zip(self.words.iter_mut()) {
            *sum += f64::from(std::mem::take(word.get_mut()));
        }
        for (index, count) in self.carries.drain(..) {
            sums[index] += f64::from(count) * 4_294_967_296.0;
        }
        true
    }
}

/// Means and sums of squared deviations of many quantities, in units per photon: what power the photons have does not
/// decide what single precision holds.
#[derive(Debug, Clone, Default)]
pub struct Moments {
    /// Mean over the batches so far.
    pub mean: Vec<f64>,
    /// Sum of squared deviations from it.
    pub m2: Vec<f32>,
}

impl Moments {
    /// `len` quantities without a batch.
    pub fn new(len: usize) -> Self {
        Moments { mean: vec![0.0; len], m2: vec![0.0; len] }
    }

    /// Takes in batch number `count` (from 1) of some quantities.
    pub fn update(mean: &mut [f64], m2: &mut [f32], count: u64, values: &[f64]) {
        let share = 1.0 / count as f64;
        for ((mean, m2), x) in mean.iter_mut().zip(m2).zip(values) {
            let before = x - *mean;
            *mean += before * share;
            *m2 += (before * (x - *mean)) as f32;
        }
    }

    /// Means and standard errors after `count` batches, with the channel fastest, each times what a unit is. Where nothing
    /// was ever counted the batches do not tell the error: it is `one`, what one photon would have left there.
    pub fn settle(&self, unit: &[f64], one: &[f64], count: u64) -> (Vec<f32>, Vec<f32>) {
        let channels = unit.len();
        let mean = self.mean.par_iter().enumerate().map(|(at, mean)| (mean * unit[at % channels]) as f32);
        let error = |(at, m2): (usize, &f32)| {
            let c = at % channels;
            match count {
                _ if one[c] == 0.0 => 0.0,
                2.. if self.is_empty(at) => one[c] as f32,
                _ => (f64::from(Moments::error(*m2, count)) * unit[c]) as f32,
            }
        };
        (mean.collect(), self.m2.par_iter().enumerate().map(error).collect())
    }

    /// Whether nothing was ever counted of a quantity.
    pub fn is_empty(&self, at: usize) -> bool {
        self.mean[at] == 0.0 && self.m2[at] == 0.0
    }

    /// The voxels of some channels of which nothing was ever counted in any, if there are such.
    pub fn unreached(&self, channels: usize) -> Option<Vec<bool>> {
        let voxels = self.mean.len() / channels;
        let empty = |voxel: usize| (0..channels).all(|c| self.is_empty(voxel * channels + c));
        let unreached: Vec<bool> = (0..voxels).into_par_iter().map(empty).collect();
        unreached.contains(&true).then_some(unreached)
    }

    /// Standard error of the mean of one quantity after `count` batches; infinite where one batch tells nothing.
    pub fn error(m2: f32, count: u64) -> f32 {
        if count < 2 { f32::INFINITY } else { (f64::from(m2) / ((count - 1) as f64 * count as f64)).sqrt() as f32 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_carry_beyond_32_bits() {
        let mut sets = [Bins::new(3, true), Bins::new(3, false)];
        for _ in 0..5 {
            sets[0].add(1, 2_000_000_000.0, 0.0);
            sets[1].add(1, 2_000_000_000.0, 0.0);
            sets[1].add(0, -2_000_000_000.0, 0.0);
        }
        sets[0].add(1, 3.0e10, 0.0);
        sets[0].add(0, -3.0e10, 0.0);
        sets[1].add(2, 7.0, 0.5);
        for _ in 0..2 {
            // The second time they are empty.
            let mut sums = [0.0; 3];
            for bins in &mut sets {
                for (at, block) in bins.blocks(2).iter_mut().enumerate() {
                    block.drain(&mut sums[2 * at..]);
                }
            }
            let expected = [-1.0e10 - f64::from(3.0e10f32), 10.0 * 2_000_000_000.0 + f64::from(3.0e10f32), 7.0];
            assert!(sums == expected || sums == [0.0; 3], "{sums:?}");
            sets[0].add(0, 0.0, 0.0);
        }
        let mut again = [0.0; 3];
        sets[0].blocks(3)[0].drain(&mut again);
        assert_eq!(again, [0.0; 3]);
    }

    #[test]
    fn stochastic_rounding_keeps_the_mean_of_tiny_deposits() {
        let mut bins = Bins::new(1, false);
        let n = 100_000;
        for i in 0..n as u32 {
            bins.add(0, 0.01, (i.wrapping_mul(2_654_435_769) >> 8) as f32 / 16_777_216.0);
        }
        let mut sum = [0.0];
        bins.blocks(1)[0].drain(&mut sum);
        let got = sum[0];
        assert!((got / (0.01 * f64::from(n)) - 1.0).abs() < 0.05, "{got}");
    }

    #[test]
    fn welford_agrees_with_the_textbook() {
        let (mut mean, mut m2) = ([0.0], [0.0f32]);
        let data = [1.0, 4.0, 2.0, 8.0, 5.0];
        for (i, &x) in data.iter().enumerate() {
            Moments::update(&mut mean, &mut m2, i as u64 + 1, &[x]);
        }
        let ([mean], [m2]) = (mean, m2);
        let variance = data.iter().map(|x| (x - 4.0) * (x - 4.0)).sum::<f64>() / 4.0;
        assert!((mean - 4.0).abs() < 1e-12);
        assert!((f64::from(Moments::error(m2, 5)) - (variance / 5.0).sqrt()).abs() < 1e-6);
    }
}
