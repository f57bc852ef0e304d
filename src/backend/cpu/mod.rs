//! The CPU backend: runs a plan on all cores, with the same bits for any number of threads.

pub mod angular;
pub mod emit;
mod emitted;
mod even;
pub mod flights;
pub mod gather;
pub mod lanes;
pub mod light;
pub mod path;
pub mod pixel_error;
mod settle;
pub mod shoot;
pub mod simd;
mod sweep;
pub mod track;

use crate::backend::{Control, Device};
use crate::error::{Error, Result};
use crate::plan::{Column, Layer, Plan, Tracker, cost};
use crate::result::{Outcome, Stopped};
use crate::scene::field::{Field, Occupancy};
use crate::scene::{Light, Scene};
use crate::tally::{Bins, Block, Moments, REFERENCE_UNITS};
use emit::Emitter;
use lanes::Laned;
use light::Illumination;
use rayon::prelude::*;
use shoot::{Energies, Engine, OneByOne, Walk};
use track::{Analytic, March, Woodcock};

/// Runs `work` on a pool of the given number of threads.
pub fn with_threads<T: Send>(threads: Option<usize>, work: impl FnOnce() -> T + Send) -> Result<T> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(cost::threads(threads))
        .build()
        .map_err(|e| Error::Internal(format!("the threads could not be started: {e}")))?;
    Ok(pool.install(work))
}

/// Runs a plan.
pub fn run(plan: &Plan, control: &Control) -> Result<Outcome> {
    with_threads(plan.settings.threads, || {
        if plan.paths.is_some() { path::run(plan, &Device::Cpu, control) } else { run_here(plan, control) }
    })?
}

fn run_here(plan: &Plan, control: &Control) -> Result<Outcome> {
    let occupancy = Occupancy::new(&plan.scene.medium.volume);
    let occupancy = occupancy.as_ref();
    let columns = light_grids(plan, occupancy, control);
    let views = illuminations(plan.scene, occupancy, plan.lights.iter().map(|l| l.column), &columns);
    let emitters: Vec<Emitter> = plan
        .scene
        .lights
        .iter()
        .zip(&plan.lights)
        .zip(&views)
        .filter_map(|((light, how), view)| Emitter::new(plan.scene, light, how, view.as_ref()))
        .chain(Emitter::medium(plan.scene))
        .collect();
    if control.stopped() {
        return Err(Error::Interrupted);
    }
    let light_seconds = control.seconds();
    let mut shot = Shot::new(plan);
    if plan.shoots() && !emitters.is_empty() {
        match plan.channels {
            1 => shoot_grey::<1>(plan, &emitters, &views, occupancy, control, &mut shot)?,
            _ if plan.chromatic => shoot_chromatic(plan, &emitters, &views, occupancy, control, &mut shot)?,
            _ => shoot_grey::<3>(plan, &emitters, &views, occupancy, control, &mut shot)?,
        }
    }
    drop(emitters);
    let photon_seconds = control.seconds() - light_seconds;
    let mut outcome = settle::settle(plan, &views, shot, control)?;
    drop(views);
    outcome.columns = plan
        .lights
        .iter()
        .zip(columns)
        .map(|(light, grid)| grid.filter(|_| light.column == Column::Grid && plan.settings.image))
        .collect();
    outcome.seconds = [light_seconds, photon_seconds, control.seconds() - light_seconds - photon_seconds];
    Ok(outcome)
}

/// The light grids of the lights that need them.
fn light_grids(plan: &Plan, occupancy: Option<&Occupancy>, control: &Control) -> Vec<Option<Vec<f32>>> {
    let scene = plan.scene;
    let grid = |(light, how): (&Light, &crate::plan::LightPlan)| {
        if !cost::uses_grid(how, light, scene.medium.volume.is_constant()) {
            return None;
        }
        Illumination::new(scene, occupancy, light, how.column, None).map(|view| view.columns(control))
    };
    scene.lights.iter().zip(&plan.lights).map(grid).collect()
}

/// The views of all lights, `None` for those without a direction.
pub fn illuminations<'a>(
    scene: &'a Scene<'a>,
    occupancy: Option<&'a Occupancy>,
    how: impl Iterator<Item = Column>,
    columns: &'a [Option<Vec<f32>>],
) -> Vec<Option<Illumination<'a>>> {
    scene
        .lights
        .iter()
        .zip(how)
        .zip(columns)
        .map(|((light, column), nodes)| Illumination::new(scene, occupancy, light, column, nodes.as_deref()))
        .collect()
}

/// What the photons left.
struct Shot {
    /// Fluence of all tallied orders.
    fluence: Moments,
    /// J of all tallied orders (absent where it is the fluence over 4 pi).
    source: Moments,
    /// J of incident order 0, summed over batches.
    source0: Vec<f64>,
    /// Sums of the replicates, one volume each, of J or its harmonics.
    subvolumes: Vec<Vec<f32>>,
    /// Batches in each replicate.
    subvolume_batches: Vec<u64>,
    /// Energies of each batch, and the power that a weight of 1 stands for.
    energies: Vec<(Energies, f64, u64)>,
    batches: u64,
    photons: u64,
    stopped: Stopped,
    warning: Option<String>,
}

impl Shot {
    fn new(plan: &Plan) -> Self {
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
            source0: vec![0.0; if sampled0 && plan.wants_source() { values * plan.width() } else { 0 }],
            subvolumes: vec![vec![0.0; values * plan.width()]; plan.sums()],
            subvolume_batches: vec![0; plan.sums()],
            energies: Vec::new(),
            batches: 0,
            photons: 0,
            stopped: Stopped::Photons,
            warning: None,
        }
    }
}

fn shoot_grey<const C: usize>(
    plan: &Plan,
    emitters: &[Emitter],
    views: &[Option<Illumination>],
    occupancy: Option<&Occupancy>,
    control: &Control,
    shot: &mut Shot,
) -> Result<()>
where
    for<'a> Woodcock<'a, false>: track::Tracker<C>,
{
    let medium = &plan.scene.medium;
    let field = Field::density(&medium.volume);
    let scores = !plan.layers.is_empty();
    let extinction = medium.extinction.rgb;
    if plan.lanes {
        return batches::<C>(plan, &Laned::<C>::new(plan), emitters, views, occupancy, control, shot);
    }
    match (plan.tracker, &plan.majorant) {
        (Tracker::Woodcock, Some(grid)) => {
            let tracker = Woodcock::<false>::new(plan, grid);
            batches::<C>(plan, &OneByOne::<_, C>(tracker), emitters, views, occupancy, control, shot)
        }
        (Tracker::Analytic, _) => {
            let sigma_t = medium.max_sigma_t() as f32;
            let tracker = Analytic { field, sigma_t, score: plan.score, scores };
            batches::<C>(plan, &OneByOne::<_, C>(tracker), emitters, views, occupancy, control, shot)
        }
        _ => {
            let tracker = March::<false> { field, extinction: extinction.map(|e| e as f32), scores };
            batches::<C>(plan, &OneByOne::<_, C>(tracker), emitters, views, occupancy, control, shot)
        }
    }
}

fn shoot_chromatic(
    plan: &Plan,
    emitters: &[Emitter],
    views: &[Option<Illumination>],
    occupancy: Option<&Occupancy>,
    control: &Control,
    shot: &mut Shot,
) -> Result<()> {
    let medium = &plan.scene.medium;
    let field = Field::density(&medium.volume);
    let scores = !plan.layers.is_empty();
    let extinction = medium.extinction.rgb;
    match &plan.majorant {
        Some(grid) => {
            let tracker = Woodcock::<true>::new(plan, grid);
            batches::<3>(plan, &OneByOne::<_, 3>(tracker), emitters, views, occupancy, control, shot)
        }
        None => {
            let tracker = March::<true> { field, extinction: extinction.map(|e| e as f32), scores };
            batches::<3>(plan, &OneByOne::<_, 3>(tracker), emitters, views, occupancy, control, shot)
        }
    }
}

/// Bin units per weight * length: a typical deposit is 65,536 units, one along a voxel at most 2^24.
fn bin_unit(plan: &Plan) -> f64 {
    let h = plan.scene.medium.volume.spacing().into_iter().fold(f64::INFINITY, f64::min);
    let free = 1.0 / plan.scene.medium.max_sigma_t().max(1e-30);
    (REFERENCE_UNITS / h.min(free)).min(16_777_216.0 / h)
}

/// Walks batch after batch until the plan, the target, the clock or the user says stop.
fn batches<const C: usize>(
    plan: &Plan,
    engine: &impl Engine,
    emitters: &[Emitter],
    views: &[Option<Illumination>],
    occupancy: Option<&Occupancy>,
    control: &Control,
    shot: &mut Shot,
) -> Result<()> {
    let values = plan.scene.medium.volume.voxels() * C;
    let sets = cost::bin_sets(plan);
    let new = |layer: &Layer| Bins::new(values * plan.width_of(*layer), sets == 1);
    let mut bins: Vec<Vec<Bins>> = plan.layers.iter().map(|layer| (0..sets).map(|_| new(layer)).collect()).collect();
    let unit = bin_unit(plan);
    let mut walk = Walk { plan, emitters, bins: Vec::new(), sets, unit: unit as f32 };
    let power: f64 = emitters.iter().map(|e| e.power).sum();
    let round = plan.subvolumes.max(8) as u64;
    let mut goal = plan.batches.unwrap_or(if plan.target_error.is_some() { round } else { u64::MAX });
    loop {
        while shot.batches < goal {
            let photons = plan.photons_of(shot.batches);
            // Two batches make an error bar: until then the clock does not cut a batch short.
            walk.bins = std::mem::take(&mut bins);
            let finished = walk.batch(engine, shot.photons, photons, control, shot.batches >= 2);
            bins = std::mem::take(&mut walk.bins);
            let Some(energies) = finished else {
                shot.stopped = if control.finishing() { Stopped::Progress } else { Stopped::TimeLimit };
                return if control.stopped() { Err(Error::Interrupted) } else { Ok(()) };
            };
            shot.batches += 1;
            shot.photons += photons;
            fold(plan, &mut bins, power / photons as f64 / unit, shot);
            shot.energies.push((energies, power / photons as f64, photons));
            // How many batches a target takes is known only after the first estimate, which comes soon.
            let scale = if plan.batches.is_none() && goal == round { 0.1 } else { 1.0 };
            let part = if goal == u64::MAX { 0.0 } else { scale * shot.batches as f64 / goal as f64 };
            control.report(part.max(control.time_fraction()), shot.photons);
            if shot.batches >= 2 && control.late() && shot.batches < goal {
                shot.stopped = if control.finishing() { Stopped::Progress } else { Stopped::TimeLimit };
                return Ok(());
            }
        }
        let Some(target) = plan.target_error.filter(|_| plan.batches.is_none()) else { return Ok(()) };
        let (noise, bias) = settle::relative_error(plan, views, shot, occupancy, control);
        if noise.hypot(bias) <= target {
            shot.stopped = Stopped::TargetError;
            return Ok(());
        }
        if bias > 0.9 * target && noise <= target {
            shot.stopped = Stopped::TargetError;
            shot.warning = Some(format!(
                "target_error = {target} is out of reach: the bias of the voxels' size is {bias:.2e} (noise {noise:.2e}), \
                 which more photons do not cure, but smaller voxels do"
            ));
            return Ok(());
        }
        // Noise falls as the root of the photons; no more than eightfold at once, for it is itself an estimate.
        let room = (target * target - bias * bias).max(0.19 * target * target);
        let factor = (noise * noise / room * 1.05).clamp(1.1, 8.0);
        goal = ((shot.batches as f64 * factor) as u64).div_ceil(round) * round;
    }
}

/// Ends a batch: its deposits go into the moments and one replicate. `scale` makes units into J or fluence times volume.
fn fold(plan: &Plan, bins: &mut [Vec<Bins>], scale: f64, shot: &mut Shot) {
    // Whole voxels, of 1 or 3 channels.
    const BLOCK: usize = 3 << 9;
    if bins.is_empty() {
        return;
    }
    let scale = scale / plan.scene.medium.volume.voxel_volume();
    let isotropic = plan.scene.medium.phase.is_isotropic();
    let per_sphere = 0.25 * std::f64::consts::FRAC_1_PI;
    let count = shot.batches;
    let replicates = plan.sums();
    let width = plan.width();
    let toward = plan.harmonics.map(|order| angular::Towards::new(plan.scene, &plan.scene.camera, order));
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
    let source0 = pad(shot.source0.chunks_mut(BLOCK * width), blocks);
    let subvolume = pad(subvolume.chunks_mut(BLOCK * width), blocks);
    drains.into_par_iter().zip(fluence).zip(source).zip(source0).zip(subvolume).enumerate().for_each(
        |(at, ((((mut drains, fluence), source), source0), subvolume))| {
            let len = BLOCK.min(values - at * BLOCK);
            // Fluence, J of incident order 0, and J of all orders that images see; those that somebody wants.
            let wanted = [fluence.is_some(), source0.is_some(), source.is_some() || subvolume.is_some()];
            let widths = [1, width, width];
            let mut sums = [0, 1, 2].map(|i| vec![0.0f64; if wanted[i] { len * widths[i] } else { 0 }]);
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
                };
                for &(to, factor) in goes {
                    sums[to].iter_mut().zip(units.iter()).for_each(|(sum, x)| *sum += x * (factor * scale));
                }
            }
            if let Some((mean, m2)) = fluence {
                Moments::update(mean, m2, count, &sums[0]);
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
                sum.iter_mut().zip(&sums[1]).for_each(|(sum, x)| *sum += x);
            }
            if let Some(sum) = subvolume.filter(|_| any) {
                sum.iter_mut().zip(&sums[2]).for_each(|(sum, x)| *sum += *x as f32);
            }
        },
    );
}

/// The items, followed by `None` up to `len`.
fn pad<T>(items: impl Iterator<Item = T>, len: usize) -> Vec<Option<T>> {
    let mut list: Vec<Option<T>> = items.map(Some).collect();
    list.resize_with(len, || None);
    list
}
