//! Fixed-point tallies: bins that threads add to in any order with the same bits, and the moments that batches fold into.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// A deposit of the reference size in units of a bin. Deposits are rounded stochastically, so none rounds away.
pub const REFERENCE_UNITS: f64 = 65_536.0;

/// One batch's deposits: 32-bit words, and the carries out of them. One set per thread, whose additions then need no
/// locked instruction, or one that all threads share.
#[derive(Debug)]
pub struct Bins {
    words: Vec<AtomicU32>,
    shared: bool,
    carries: Mutex<Vec<(usize, u32)>>,
}

impl Bins {
    /// `len` empty bins, which several threads may add to if `shared`.
    pub fn new(len: usize, shared: bool) -> Self {
        let mut words = Vec::new();
        words.resize_with(len, AtomicU32::default);
        Bins { words, shared, carries: Mutex::default() }
    }

    /// Adds `value` (in units, not negative), rounded up with the chance of its fraction; `xi` within [0, 1).
    #[inline(always)]
    pub fn add(&self, index: usize, value: f32, xi: f32) {
        let value = value + xi;
        if value < 2_147_483_648.0 {
            self.add_word(index, value as u32);
        } else {
            self.add_large(index, f64::from(value) as u64);
        }
    }

    #[inline(always)]
    fn add_word(&self, index: usize, increment: u32) {
        let word = &self.words[index];
        let old = if self.shared {
            word.fetch_add(increment, Relaxed)
        } else {
            let old = word.load(Relaxed);
            word.store(old.wrapping_add(increment), Relaxed);
            old
        };
        if old.checked_add(increment).is_none() {
            self.carry(index, 1);
        }
    }

    #[cold]
    fn add_large(&self, index: usize, increment: u64) {
        self.add_word(index, increment as u32);
        if increment >> 32 > 0 {
            self.carry(index, (increment >> 32) as u32);
        }
    }

    #[cold]
    fn carry(&self, index: usize, count: u32) {
        if let Ok(mut carries) = self.carries.lock() {
            carries.push((index, count));
        }
    }

    /// The carries since the last call, summed and sorted by bin.
    fn take_carries(&self) -> Vec<(usize, u64)> {
        let mut list = self.carries.lock().map(|mut c| std::mem::take(&mut *c)).unwrap_or_default();
        list.sort_unstable_by_key(|c| c.0);
        let mut sums: Vec<(usize, u64)> = Vec::new();
        for (index, count) in list {
            match sums.last_mut() {
                Some(last) if last.0 == index => last.1 += u64::from(count),
                _ => sums.push((index, u64::from(count))),
            }
        }
        sums
    }
}

/// A batch that is over: reads each bin once and leaves it empty.
pub struct Drain<'a> {
    bins: &'a [Vec<Bins>],
    carries: Vec<Vec<Vec<(usize, u64)>>>,
}

impl<'a> Drain<'a> {
    /// Ends the batch of these layers, each of one or several sets of bins.
    pub fn new(bins: &'a [Vec<Bins>]) -> Self {
        let carries = bins.iter().map(|sets| sets.iter().map(Bins::take_carries).collect()).collect();
        Drain { bins, carries }
    }

    /// The sum in a bin of a layer, in units.
    #[inline(always)]
    pub fn take(&self, layer: usize, index: usize) -> f64 {
        let mut sum = 0u64;
        for (set, carries) in self.bins[layer].iter().zip(&self.carries[layer]) {
            // Nobody else adds by now: a load and a store are cheaper than a locked exchange.
            let word = &set.words[index];
            sum += u64::from(word.load(Relaxed));
            word.store(0, Relaxed);
            if !carries.is_empty()
                && let Ok(at) = carries.binary_search_by_key(&index, |c| c.0)
            {
                sum += carries[at].1 << 32;
            }
        }
        sum as f64
    }
}

/// Means and sums of squared deviations of many quantities.
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

    /// Takes in batch number `count` (from 1) of one quantity.
    #[inline(always)]
    pub fn update(mean: &mut f64, m2: &mut f32, count: u64, x: f64) {
        if x == 0.0 && *mean == 0.0 {
            return; // most voxels of a sparse scene
        }
        let before = x - *mean;
        *mean += before / count as f64;
        *m2 = (f64::from(*m2) + before * (x - *mean)) as f32;
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
        let bins = [vec![Bins::new(3, true), Bins::new(3, false)]];
        for _ in 0..5 {
            bins[0][0].add(1, 2_000_000_000.0, 0.0);
            bins[0][1].add(1, 2_000_000_000.0, 0.0);
        }
        bins[0][0].add(1, 3.0e10, 0.0);
        bins[0][1].add(2, 7.0, 0.5);
        let drain = Drain::new(&bins);
        assert_eq!(drain.take(0, 0), 0.0);
        let expected = 10.0 * 2_000_000_000.0 + f64::from(3.0e10f32);
        assert_eq!(drain.take(0, 1), expected);
        assert_eq!(drain.take(0, 2), 7.0);
    }

    #[test]
    fn stochastic_rounding_keeps_the_mean_of_tiny_deposits() {
        let bins = [vec![Bins::new(1, false)]];
        let n = 100_000;
        for i in 0..n as u32 {
            bins[0][0].add(0, 0.01, (i.wrapping_mul(2_654_435_769) >> 8) as f32 / 16_777_216.0);
        }
        let got = Drain::new(&bins).take(0, 0);
        assert!((got / (0.01 * f64::from(n)) - 1.0).abs() < 0.05, "{got}");
    }

    #[test]
    fn welford_agrees_with_the_textbook() {
        let (mut mean, mut m2) = (0.0, 0.0f32);
        let data = [1.0, 4.0, 2.0, 8.0, 5.0];
        for (i, &x) in data.iter().enumerate() {
            Moments::update(&mut mean, &mut m2, i as u64 + 1, x);
        }
        let variance = data.iter().map(|x| (x - 4.0) * (x - 4.0)).sum::<f64>() / 4.0;
        assert!((mean - 4.0).abs() < 1e-12);
        assert!((f64::from(Moments::error(m2, 5)) - (variance / 5.0).sqrt()).abs() < 1e-6);
    }
}
