//! How a plan runs, whatever on: light grids, photons batch by batch until it is enough, and the sum of it all.

use super::bias::Truth;
use super::cpu::emit::Emitter;
use super::cpu::shoot::total;
use super::cpu::{self, path, settle};
#[cfg(feature = "gpu")]
use super::gpu;
use super::shot::{Shooter, Shot, fold, stopped_by};
use super::single::single;
use super::views::{illuminations, light_grids};
use super::{Control, Device};
use crate::error::{Error, Result};
use crate::plan::{Column, Plan};
use crate::result::{Order0, Outcome, Stopped};
use crate::scene::field::Occupancy;

/// A run that an error cut short: what it had finished, from which it goes on to the same bits.
#[derive(Debug, Clone)]
pub struct Unfinished {
    /// What happened.
    pub why: Error,
    rest: Rest,
}

/// What a run left.
#[derive(Debug, Clone)]
enum Rest {
    Photons(Box<Shot>),
    Paths(path::Taken),
}

/// Runs a plan, or goes on with a run of it that was cut short. The second value is there if this was cut short too; what
/// it had finished is the outcome then.
pub fn run(
    plan: &Plan,
    device: &Device,
    control: &Control,
    before: Option<Unfinished>,
) -> Result<(Outcome, Option<Unfinished>)> {
    cpu::with_threads(plan.settings.threads, || {
        if plan.paths.is_some() {
            let taken = before.and_then(|before| match before.rest {
                Rest::Paths(taken) => Some(taken),
                Rest::Photons(_) => None,
            });
            let (outcome, rest) = path::run(plan, device, control, taken)?;
            Ok((outcome, rest.map(|(why, taken)| Unfinished { why, rest: Rest::Paths(taken) })))
        } else {
            run_here(plan, device, control, before)
        }
    })?
}

fn run_here(
    plan: &Plan,
    device: &Device,
    control: &Control,
    before: Option<Unfinished>,
) -> Result<(Outcome, Option<Unfinished>)> {
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
    let mut shot = match before.map(|before| before.rest) {
        Some(Rest::Photons(shot)) => *shot,
        _ => Shot::new(plan, total(&emitters.iter().map(|e| e.powers).collect::<Vec<_>>())),
    };
    let mut unfinished = None;
    let (mut truth, mut order0) = (None, None);
    if plan.shoots() && !emitters.is_empty() {
        truth = Truth::trace(plan, control)?;
        let shooting = || -> Result<Box<dyn Shooter + '_>> {
            Ok(match device {
                Device::Cpu => cpu::shooter(plan, &emitters),
                #[cfg(feature = "gpu")]
                Device::Gpu(gpu) => Box::new(gpu::shoot::Shooting::new(gpu, plan, &emitters)?),
            })
        };
        let error = |shot: &mut Shot| {
            let (noise, bias) = settle::relative_error(plan, device, &views, shot, &mut order0, occupancy, control)?;
            match truth.as_ref().filter(|_| plan.over_pixels()) {
                Some(truth) => Ok((noise, truth.bias(plan, &views, shot, occupancy, control)?.size)),
                None => Ok((noise, bias)),
            }
        };
        let ended = shooting().and_then(|mut shooter| batches(plan, &mut *shooter, error, control, &mut shot));
        match ended {
            Err(why) if shot.batches > 0 && why != Error::Interrupted => {
                shot.stopped = stopped_by(&why);
                unfinished = Some(Unfinished { why, rest: Rest::Photons(Box::new(shot.clone())) });
            }
            ended => ended?,
        }
    }
    drop(emitters);
    let photon_seconds = control.seconds() - light_seconds;
    let bias = match truth.filter(|_| unfinished.is_none()) {
        Some(truth) => Some(truth.bias(plan, &views, &shot, occupancy, control)?),
        None => None,
    };
    let mut outcome = settle::settle(plan, shot, order0);
    if control.stopped() {
        return Err(Error::Interrupted);
    }
    outcome.warnings.extend(bias.and_then(|bias| bias.warning(plan)));
    drop(views);
    outcome.columns = plan
        .lights
        .iter()
        .zip(columns)
        .map(|(light, grid)| grid.filter(|_| light.column == Column::Grid && plan.settings.image))
        .collect();
    outcome.seconds = [light_seconds, photon_seconds, control.seconds() - light_seconds - photon_seconds];
    Ok((outcome, unfinished))
}

/// What unscattered light adds to the voxels of a run of the plan.
pub fn order0(plan: &Plan, control: &Control) -> Result<Order0> {
    Ok(settle::order0(plan, single(plan, control)?))
}

/// Walks batch after batch until the plan, the target, the clock or the user says stop; `error` estimates the relative
/// noise and bias of what was shot.
fn batches(
    plan: &Plan,
    shooter: &mut dyn Shooter,
    mut error: impl FnMut(&mut Shot) -> Result<(f64, f64)>,
    control: &Control,
    shot: &mut Shot,
) -> Result<()> {
    let round = plan.subvolumes.max(8) as u64;
    let first = plan.batches.unwrap_or(if plan.target_error.is_some() { round } else { u64::MAX });
    let mut goal = shot.goal.unwrap_or(first);
    shot.stopped = Stopped::Photons;
    loop {
        while shot.batches < goal {
            let photons = plan.photons_of(shot.batches);
            // Two batches make an error bar: until then the clock does not cut a batch short.
            let Some(energies) = shooter.batch(shot.photons, photons, control, shot.batches >= 2)? else {
                shot.stopped = if control.finishing() { Stopped::Progress } else { Stopped::TimeLimit };
                return if control.stopped() { Err(Error::Interrupted) } else { Ok(()) };
            };
            let bins = shooter.bins()?;
            shot.batches += 1;
            shot.photons += photons;
            fold(plan, bins, photons, shot);
            shot.energies.push((energies, photons));
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
        if control.late() {
            shot.stopped = if control.finishing() { Stopped::Progress } else { Stopped::TimeLimit };
            return Ok(());
        }
        let (noise, bias) = error(shot)?;
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
        shot.goal = Some(goal);
    }
}
