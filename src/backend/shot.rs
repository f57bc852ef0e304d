//! What the photons of a run leave: moments of voxels, replicates, energies; who shoots them, and how a batch is folded in.

use super::Control;
use super::cpu::angular::Towards;
use super::cpu::energies::Energies;
use crate::error::{Error, Result};
use crate::plan::{Layer, Plan};
use crate::result::Stopped;
use crate::scene::Albedo;
use crate::tally::{Bins, Block, Moments, REFERENCE_UNITS};
use rayon::prelude::*;

/// Shoots the photons of a plan, batch by batch.
pub trait Shooter {
    /// Walks the photons of one batch, `first` being the number of its first; `None` if it was stopped, by the clock too if
    /// it is `urgent`.
    fn batch(&mut self, first: u64, photons: u64, control: &Control, urgent: bool) -> Result<Option<Energies>>;

    /// What they left in the bins of each tally layer, to be emptied.
    fn bins(&mut self) -> Result<&mut [Vec<Bins>]>;
}

/// What the photons left.
#[derive(Debug, Clone)]
pub struct Shot {
    /// Fluence of all tallied orders.
    pub fluence: Moments,
    /// J of all tallied orders (absent where it is the fluence over 4 pi).
    pub source: Moments,
    /// Fluence times relative absorption, where absorption is a layer.
    pub absorbed: Moments,
    /// J of incident order 0, summed over batches.
    pub source0: Vec<f64>,
    /// Sums of the replicates, one volume each, of J or its harmonics.
    pub subvolumes: Vec<Vec<f32>>,
    /// Batches in each replicate.
    pub subvolume_batches: Vec<u64>,
    /// The power of all photons [W], by channel.
    pub powers: [f64; 3],
    /// Energies of each batch, and its photons.
    pub energies: Vec<(Energies, u64)>,
    /// Finished batches.
    pub batches: u64,
    /// Photons walked.
    pub photons: u64,
    /// Batches after which the error is looked at next, once that is known.
    pub goal: Option<u64>,
    /// Why it ended.
    pub stopped: Stopped,
    /// What the user should know.
    pub warning: Option<String>,
}

impl Shot {
    /// Nothing yet, of photons that are to have the given power by channel.
    pub fn new(plan: &Plan, powers: [f64; 3]) -> Self {
        let values = if plan.shoots() { plan.scene.medium.volume.voxels() * plan.channels } else { 0 };
        let has = |layer| plan.layers.contains(&layer);
        let keeps = plan.keeps_moments() && !plan.layers.is_empty();
        // Of harmonics only what they send to the eye of the run has a variance, for the voxels' radiance.
        let wants_source =
            keeps && plan.wants_source() && !plan.one_moment() && (plan.settings.radiance || plan.width() == 1);
        let wants_fluence = keeps && (plan.settings.fluence || plan.one_moment());
        let sampled0 = has(Layer::Unscattered) || has(Layer::EyeUnscattered) || has(Layer::HarmonicsUnscattered);
        Shot {
            fluence: Moments::new(if wants_fluence { values } else { 0 }),
            source: Moments::new(if wants_source { values } else { 0 }),
            absorbed: Moments::new(if plan.absorbed.is_some() { values } else { 0 }),
            source0: vec![0.0; if sampled0 && plan.wants_source() { values * plan.width() } else { 0 }],
            subvolumes: vec![vec![0.0; values * plan.width()]; plan.sums()],
            subvolume_batches: vec![0; plan.sums()],
            powers,
            energies: Vec::new(),
            batches: 0,
            photons: 0,
            goal: None,
            stopped: Stopped::Photons,
            warning: None,
        }
    }
}

/// How a run ends that an error cuts short.
pub fn stopped_by(why: &Error) -> Stopped {
    match why {
        Error::DeviceLost(_) => Stopped::DeviceLost,
        _ => Stopped::Error,
    }
}

/// The weight that a photon deposits with at most where the mean photon starts with 1, by channel: that, or what its first
/// scattering leaves where only scattered light is tallied.
pub fn first_weights(plan: &Plan) -> [f64; 3] {
    match plan.scene.medium.albedo {
        _ if plan.tallies_unscattered() => [1.0; 3],
        Albedo::Constant(albedo) => albedo.rgb,
        Albedo::PerVoxel(_) => [plan.scene.medium.max_albedo(); 3],
    }
}

/// Bin units per weight * length, by channel: a typical deposit is 65,536 units, one along a voxel's shortest edge at most
/// 2^24 and along its longest 2^36, of which a batch of [`crate::plan::LARGEST_BATCH`] stays within 63 bits.
pub fn bin_units(plan: &Plan) -> [f64; 3] {
    let spacing = plan.scene.medium.volume.spacing();
    let (shortest, longest) =
        (spacing.into_iter().fold(f64::INFINITY, f64::min), spacing.into_iter().fold(0.0, f64::max));
    let free = 1.0 / plan.scene.medium.max_sigma_t().max(1e-30);
    let unit = REFERENCE_UNITS / shortest.min(free);
    let unit = unit.min(16_777_216.0 / shortest).min(68_719_476_736.0 / longest);
    // Within single precision.
    first_weights(plan).map(|weight| unit / if weight > 0.0 { weight.max(1e-15) } else { 1.0 })
}

/// The fluence that one unit per photon stands for, by channel.
pub fn per_unit(plan: &Plan, powers: [f64; 3]) -> [f64; 3] {
    let units = bin_units(plan);
    std::array::from_fn(|c| powers[c] / units[c] / plan.scene.medium.volume.voxel_volume())
}

/// The fluence that one photon leaves in a voxel that it crosses, over that of all photons, by channel: the weight
/// [`first_weights`] of the mean photon along the voxel's mean chord, which is 4 volumes over its surface. 0 where no
/// layer tallies it, and it is exact.
pub fn of_one_photon(plan: &Plan, shot: &Shot) -> [f64; 3] {
    let tallied = plan.layers.iter().any(|layer| matches!(layer, Layer::Unscattered | Layer::Inner | Layer::Last));
    one_photon(plan, shot, tallied)
}

/// J of one photon likewise, were it to scatter into all directions alike.
pub fn source_of_one_photon(plan: &Plan, shot: &Shot) -> [f64; 3] {
    let isotropic = plan.scene.medium.phase.is_isotropic();
    let seen = |layer: &Layer| match layer {
        Layer::Unscattered => true,
        Layer::Inner => isotropic,
        Layer::Last | Layer::Absorbed => false,
        Layer::EyeUnscattered | Layer::Eye | Layer::HarmonicsUnscattered | Layer::Harmonics => true,
    };
    one_photon(plan, shot, plan.layers.iter().any(seen)).map(|fluence| fluence * 0.25 * std::f64::consts::FRAC_1_PI)
}

fn one_photon(plan: &Plan, shot: &Shot, tallied: bool) -> [f64; 3] {
    let [x, y, z] = plan.scene.medium.volume.spacing();
    let surface = 2.0 * (x * y + y * z + z * x);
    let weights = first_weights(plan);
    if !tallied || shot.photons == 0 {
        return [0.0; 3];
    }
    std::array::from_fn(|c| 4.0 / surface * weights[c] * shot.powers[c] / shot.photons as f64)
}

/// Ends a batch of some photons: its deposits go into the moments and one replicate.
pub fn fold(plan: &Plan, bins: &mut [Vec<Bins>], photons: u64, shot: &mut Shot) {
    // Whole voxels, of 1 or 3 channels.
    const BLOCK: usize = 3 << 9;
    if bins.is_empty() {
        return;
    }
    let each = 1.0 / photons as f64;
    let scale = per_unit(plan, shot.powers);
    let channels = plan.channels;
    let isotropic = plan.scene.medium.phase.is_isotropic();
    let per_sphere = 0.25 * std::f64::consts::FRAC_1_PI;
    let count = shot.batches;
    let replicates = plan.sums();
    let width = plan.width();
    let toward = plan.harmonics.map(|order| Towards::new(plan.scene, &plan.scene.camera, order));
    let replicate = if replicates > 0 { ((count - 1) % replicates as u64) as usize } else { 0 };
    if replicates > 0 {
        shot.subvolume_batches[replicate] += 1;
    }
    let subvolume: &mut [f32] = if replicates > 0 { &mut shot.subvolumes[replicate] } else { &mut [] };
    let values = plan.scene.medium.volume.voxels() * plan.channels;
    // Quantities that this plan does not keep have no values: their blocks are empty.
    let blocks = values.div_ceil(BLOCK);
    let mut drains: Vec<Vec<(Layer, Block)>> = (0..blocks).map(|_| Vec::new()).collect();
    for (layer, sets) in plan.layers.iter().zip(bins) {
        for set in sets {
            drains
                .iter_mut()
                .zip(set.blocks(BLOCK * plan.width_of(*layer)))
                .for_each(|(list, block)| list.push((*layer, block)));
        }
    }
    let fluence = pad(shot.fluence.mean.chunks_mut(BLOCK).zip(shot.fluence.m2.chunks_mut(BLOCK)), blocks);
    let source = pad(shot.source.mean.chunks_mut(BLOCK).zip(shot.source.m2.chunks_mut(BLOCK)), blocks);
    let absorbed = pad(shot.absorbed.mean.chunks_mut(BLOCK).zip(shot.absorbed.m2.chunks_mut(BLOCK)), blocks);
    let source0 = pad(shot.source0.chunks_mut(BLOCK * width), blocks);
    let subvolume = pad(subvolume.chunks_mut(BLOCK * width), blocks);
    drains.into_par_iter().zip(fluence).zip(absorbed).zip(source).zip(source0).zip(subvolume).enumerate().for_each(
        |(at, (((((mut drains, fluence), absorbed), source), source0), subvolume))| {
            let len = BLOCK.min(values - at * BLOCK);
            // Fluence, J of incident order 0, J of all orders that images see, and absorption; those that somebody wants.
            let images = source.is_some() || subvolume.is_some();
            let wanted = [fluence.is_some(), source0.is_some(), images, absorbed.is_some()];
            let widths = [1, width, width, 1];
            let mut sums = [0, 1, 2, 3].map(|i| vec![0.0f64; if wanted[i] { len * widths[i] } else { 0 }]);
            let mut units = vec![0.0f64; len * width];
            let mut any = false;
            for same in drains.chunk_by_mut(|a, b| a.0 == b.0) {
                // Whole units of all threads together, which are exact; then the scale.
                let layer = same[0].0;
                let units = &mut units[..len * plan.width_of(layer)];
                units.fill(0.0);
                if !same.iter_mut().fold(false, |any, (_, block)| block.drain(units) | any) {
                    continue;
                }
                any = true;
                let goes: &[(usize, f64)] = match layer {
                    Layer::Unscattered => &[(0, 1.0), (1, per_sphere), (2, per_sphere)],
                    Layer::Inner if isotropic => &[(0, 1.0), (2, per_sphere)],
                    Layer::Inner | Layer::Last => &[(0, 1.0)],
                    Layer::EyeUnscattered | Layer::HarmonicsUnscattered => &[(1, 1.0), (2, 1.0)],
                    Layer::Eye | Layer::Harmonics => &[(2, 1.0)],
                    Layer::Absorbed => &[(3, 1.0)],
                };
                for &(to, factor) in goes {
                    sums[to].iter_mut().zip(units.iter()).for_each(|(sum, x)| *sum += x * (factor * each));
                }
            }
            if let Some((mean, m2)) = fluence {
                Moments::update(mean, m2, count, &sums[0]);
            }
            if let Some((mean, m2)) = absorbed {
                Moments::update(mean, m2, count, &sums[3]);
            }
            if let Some((mean, m2)) = source {
                match &toward {
                    Some(toward) => {
                        let first = at * BLOCK / plan.channels;
                        Moments::update(mean, m2, count, &toward.contract_part(first, &sums[2], plan.channels));
                    }
                    None => Moments::update(mean, m2, count, &sums[2]),
                }
            }
            if let Some(sum) = source0.filter(|_| any) {
                sum.iter_mut().zip(&sums[1]).enumerate().for_each(|(at, (sum, x))| *sum += x * scale[at % channels]);
            }
            if let Some(sum) = subvolume.filter(|_| any) {
                let values = sum.iter_mut().zip(&sums[2]).enumerate();
                values.for_each(|(at, (sum, x))| *sum += (x * scale[at % channels]) as f32);
            }
        },
    );
}

/// The items, followed by `None` up to `len`.
pub fn pad<T>(items: impl Iterator<Item = T>, len: usize) -> Vec<Option<T>> {
    let mut list: Vec<Option<T>> = items.map(Some).collect();
    list.resize_with(len, || None);
    list
}
