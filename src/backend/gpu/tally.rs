//! Tallies on the GPU: lower and upper words of 64 bits, in one buffer each, or in parts where an adapter binds no larger
//! ones.

use super::device::Gpu;
use super::kernel::{Binding, Source};
use crate::error::{Error, Result};
use crate::plan::cost::TALLY_PARTS;

/// Names of the words in the shaders: whole, and in parts.
const WHOLE: [&str; 2] = ["tally_low", "tally_high"];
const PARTS: [&str; 2 * TALLY_PARTS as usize] = [
    "tally_low_0",
    "tally_low_1",
    "tally_low_2",
    "tally_low_3",
    "tally_high_0",
    "tally_high_1",
    "tally_high_2",
    "tally_high_3",
];

/// The bins of all layers.
#[derive(Debug)]
pub struct Tally {
    /// Lower words, then upper ones.
    words: [Vec<wgpu::Buffer>; 2],
    bins: usize,
    /// Bins of each buffer.
    part: usize,
}

/// Bins of each buffer, and how many there are.
fn parts(gpu: &Gpu, bins: u64) -> (u64, u64) {
    let most = gpu.binding() / 4;
    if bins <= most { (bins.max(1), 1) } else { (most, TALLY_PARTS) }
}

impl Tally {
    /// Empty bins.
    pub fn new(gpu: &Gpu, bins: u64) -> Result<Self> {
        let (part, count) = parts(gpu, bins);
        if part * count < bins || bins >= u64::from(u32::MAX) {
            return Err(Error::VolumeTooLarge(format!(
                "{bins} values are to be tallied, more than the GPU {} holds; use backend=\"cpu\"",
                gpu.description.name
            )));
        }
        let size = |k: u64| part.min(bins.saturating_sub(k * part)) * 4;
        let words = || (0..count).map(|k| gpu.empty(size(k))).collect::<Result<Vec<_>>>();
        Ok(Tally { words: [words()?, words()?], bins: bins as usize, part: part as usize })
    }

    /// Makes a kernel add to so many bins.
    pub fn layout(gpu: &Gpu, bins: u64, source: Source) -> Source {
        let (part, count) = parts(gpu, bins);
        let unused = if count == 1 { "tally_parts" } else { "tally_whole" };
        source.without(unused).with("PART", part as f64)
    }

    /// For kernels.
    pub fn bindings(&self) -> Vec<(&'static str, Binding<'_>)> {
        let buffers = self.words.iter().flatten();
        let names: &[&'static str] = if self.words[0].len() == 1 { &WHOLE } else { &PARTS };
        names.iter().copied().zip(buffers.map(Binding::Buffer)).collect()
    }

    /// Empties all bins.
    pub fn clear(&self, gpu: &Gpu) {
        self.words.iter().flatten().for_each(|buffer| gpu.clear(buffer));
    }

    /// The lower and the upper words of all bins.
    pub fn read(&self, gpu: &Gpu) -> Result<[Vec<u32>; 2]> {
        let [low, high] = &self.words;
        let whole = |buffers: &[wgpu::Buffer]| -> Result<Vec<u32>> {
            let mut all = Vec::with_capacity(self.bins);
            for buffer in buffers {
                all.extend(gpu.read::<u32>(buffer, self.part.min(self.bins - all.len()))?);
            }
            Ok(all)
        };
        Ok([whole(low)?, whole(high)?])
    }

    /// Sets all bins, to test what happens at their ends.
    #[cfg(test)]
    pub fn fill(&self, gpu: &Gpu, units: u64) {
        for (buffers, word) in self.words.iter().zip([units as u32, (units >> 32) as u32]) {
            for (k, buffer) in buffers.iter().enumerate() {
                gpu.write(buffer, 0, &vec![word; self.part.min(self.bins.saturating_sub(k * self.part))]);
            }
        }
    }
}
