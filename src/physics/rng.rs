//! Counter-based random numbers: a pure function of (seed, photon, draw), so that neither threads, chunks nor restarts
//! change a photon's fate.
//!
//! Philox4x32 with 7 rounds (Salmon, Moraes, Dror, Shaw, *Parallel random numbers: as easy as 1, 2, 3*, SC 2011, whose
//! table 2 lists it as passing BigCrush).

const ROUNDS: usize = 7;
const MULTIPLIER: [u32; 2] = [0xD251_1F53, 0xCD9E_8D57];
const WEYL: [u32; 2] = [0x9E37_79B9, 0xBB67_AE85];

/// Four random words for a counter under a key, after `rounds` rounds of Philox4x32. The words are kept in 64 bits, of
/// which the upper half may hold anything: in vectors that spares the packing between rounds.
#[inline(always)]
fn philox4x32(counter: [u32; 4], mut key: [u32; 2], rounds: usize) -> [u32; 4] {
    let mut c = counter.map(u64::from);
    for _ in 0..rounds {
        let a = u64::from(MULTIPLIER[0]) * (c[0] & 0xffff_ffff);
        let b = u64::from(MULTIPLIER[1]) * (c[2] & 0xffff_ffff);
        c = [(b >> 32) ^ c[1] ^ u64::from(key[0]), b, (a >> 32) ^ c[3] ^ u64::from(key[1]), a];
        key = [key[0].wrapping_add(WEYL[0]), key[1].wrapping_add(WEYL[1])];
    }
    c.map(|word| word as u32)
}

/// Four random words: block `block` of the photon `index` under `seed`, a pure function of its arguments.
#[inline(always)]
pub fn words(seed: [u32; 2], index: [u32; 2], block: u32, purpose: u32) -> [u32; 4] {
    philox4x32([index[0], index[1], block, purpose], seed, ROUNDS)
}

/// A 64-bit number as two words, the lower first.
#[inline(always)]
pub fn split(number: u64) -> [u32; 2] {
    [number as u32, (number >> 32) as u32]
}

/// The random numbers of one photon: block after block of four words.
#[derive(Debug, Clone, Copy)]
pub struct Draws {
    key: [u32; 2],
    index: [u32; 2],
    block: u32,
    purpose: u32,
}

impl Draws {
    /// The draws of photon `index` under `seed` ([`split`]); `purpose` separates uses that must not share numbers.
    #[inline(always)]
    pub fn new(seed: [u32; 2], index: u64, purpose: u32) -> Self {
        Draws { key: seed, index: split(index), block: 0, purpose }
    }

    /// Blocks used so far.
    #[inline(always)]
    pub fn block(&self) -> u32 {
        self.block
    }

    /// The next four words.
    #[inline(always)]
    pub fn next4(&mut self) -> [u32; 4] {
        let four = words(self.key, self.index, self.block, self.purpose);
        self.block = self.block.wrapping_add(1);
        four
    }
}

/// A word as a uniform number in (0, 1]: relative precision down to 2^-33, never 0.
#[inline(always)]
pub fn uniform(word: u32) -> f32 {
    (word as f32 + 0.5) * (1.0 / 4_294_967_296.0)
}

/// A word as a uniform number in (0, 1), in double precision.
#[inline(always)]
pub fn uniform64(word: u32) -> f64 {
    (f64::from(word) + 0.5) * (1.0 / 4_294_967_296.0)
}

/// What rounds a number by chance (the tally's `rounded`), uniform within (0, 1]. Its bits are mixed, for what else
/// reads the word reads its upper bits first.
#[inline(always)]
pub fn rounding(word: u32) -> f32 {
    // 31 bits, which vectors convert as they are.
    ((word.wrapping_mul(2_654_435_769) >> 1) as i32 as f32 + 0.5) * (1.0 / 2_147_483_648.0)
}

/// An exponential free flight in mean free paths, without the end that 32 bits would set at 22.9: the zero word stands
/// for all that lies beyond 32 ln 2 and draws again (the exponential has no memory).
#[inline(always)]
pub fn exponential(word: u32, draws: &mut Draws) -> f32 {
    if word != 0 { -uniform(word).ln() } else { 32.0 * std::f32::consts::LN_2 - uniform(draws.next4()[0]).ln() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn philox_matches_the_known_answers_of_random123() {
        // kat_vectors of Random123 1.14, philox4x32 with 7 and 10 rounds.
        assert_eq!(
            philox4x32([0; 4], [0; 2], 10),
            [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8],
            "10 rounds, zeros"
        );
        assert_eq!(
            philox4x32([0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344], [0xa409_3822, 0x299f_31d0], 10),
            [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1],
            "10 rounds, digits of pi"
        );
        assert_eq!(philox4x32([0; 4], [0; 2], 7), [0x5f6f_b709, 0x0d89_3f64, 0x4f12_1f81, 0x4f73_0a48], "7 rounds");
    }

    #[test]
    fn uniform_never_leaves_zero_to_one() {
        assert!(uniform(0) > 0.0 && uniform(u32::MAX) <= 1.0);
    }

    #[test]
    fn exponential_reaches_beyond_the_precision_of_one_word() {
        let mut draws = Draws::new([1, 0], 2, 3);
        assert!(exponential(0, &mut draws) > 22.18);
        assert!(exponential(u32::MAX, &mut draws) >= 0.0);
    }
}
