//! How many photons make a batch.

use super::Settings;
use crate::error::{Result, scene_error};

/// Photons of a batch at most. In units of 2^-36 of the mean photon's weight the energies of so many are 2^60: eight times
/// as much, which single photons of more weight (starts at first collisions, survivors of roulette, unequal extinctions)
/// may make of it by chance, still has its place in 63 bits. Photons are numbered within a batch in 32.
pub const LARGEST_BATCH: u64 = 1 << 24;

/// Photons per batch and, if their number is given, batches: enough batches for a variance, few enough that folding them
/// into the moments (a sweep over the volume) stays small beside the walk. Every light has a photon in every batch.
pub(super) fn choose(
    settings: &Settings,
    emitters: u64,
    voxels: usize,
    subvolumes: usize,
    per_second: f64,
) -> Result<(u64, Option<u64>)> {
    let round = subvolumes.max(8) as u64;
    // Each fold costs as much as a few photons per voxel of its sweep.
    let worth = (voxels as u64 / 4).clamp(1, LARGEST_BATCH);
    match settings.photons {
        Some(photons) if photons < emitters => {
            scene_error(format!("photons = {photons} is not allowed; each of the {emitters} lights needs one at least"))
        }
        Some(photons) => {
            // Batches are short beside a second, so that a run can stop at any time with what it has.
            let least = photons.div_ceil(worth.max(1 << 18));
            let batches = (photons / worth).clamp(round, 64).max(least).div_ceil(round) * round;
            let batches = batches.min(photons / emitters);
            Ok((photons.div_ceil(batches), Some(batches)))
        }
        None => {
            let mut size = (worth / 4).clamp(8192, 1 << 22);
            if let Some(limit) = settings.time_limit {
                size = size.min(((per_second * limit / 32.0) as u64).max(256));
            }
            Ok((size.max(emitters), None))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_stay_within_what_their_sums_hold() {
        let settings = |photons| Settings { photons, ..Settings::default() };
        for voxels in [1, 1000, 1 << 21, 1 << 27, 1 << 30, 1 << 36] {
            for photons in [1, 100, 1 << 18, (1 << 24) - 1, 1 << 27, (1 << 27) + 1, 3 << 30, 1_000_000_000_000_000] {
                for emitters in [1, 3, 40].into_iter().filter(|&emitters| emitters <= photons) {
                    let (size, batches) =
                        choose(&settings(Some(photons)), emitters, voxels, 16, 1e6).expect("enough photons");
                    let batches = batches.expect("their number is given");
                    let largest = photons / batches + u64::from(photons % batches > 0);
                    assert!(largest == size && size <= LARGEST_BATCH, "{voxels} {photons}: {batches} of {largest}");
                    assert!(photons / batches >= emitters, "{voxels} {photons} {emitters}: {batches}");
                }
            }
            let open = choose(&settings(None), 1, voxels, 16, 1e12).expect("enough photons");
            assert!(open.0 <= LARGEST_BATCH);
        }
        // Eight times the energies of so many mean photons are within 63 bits.
        assert!(LARGEST_BATCH * 8 <= (1 << 63 >> 36) && LARGEST_BATCH < u64::from(u32::MAX));
    }
}
