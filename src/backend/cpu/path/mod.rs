//! Path tracing from the camera: unbiased images, one independent estimate per view ray.
//!
//! A view ray is walked once, and the paths that it starts begin at collisions drawn from it; weights hold the chance that
//! there is one. From there paths run against the light by null-collision flights (or any tracker), and are connected to
//! every light at each real collision. Each pixel's mean and standard error are those of its rays.

pub mod connect;
mod lanes;
mod primary;
pub mod walk;

use super::collision_medium::Medium;
use super::gather::{Volumes, image};
use super::pixel_error;
use super::track::{self, Analytic, March, Woodcock};
#[cfg(feature = "gpu")]
use crate::backend::gpu;
use crate::backend::shot::stopped_by;
use crate::backend::views::{illuminations, light_grids};
use crate::backend::{Control, Device};
use crate::error::{Error, Result};
use crate::plan::{PathPlan, Plan, Tracker};
use crate::result::{Outcome, Pixels, Stopped};
use crate::scene::Light;
use crate::scene::field::{Field, Occupancy};
use crate::scene::medium::Emission;
use connect::Connections;
use lanes::Laned;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use walk::OneByOne;

/// View rays of a job, about: many enough to fill lanes, few enough for all threads to end together.
const JOB: usize = 1024;
/// Rays per pixel after which an error is first looked at.
const ROUND: u64 = 8;

/// View rays that one thread takes: all of a range of numbers in each of a range of pixels.
pub struct Job<'a> {
    /// The plan.
    pub plan: &'a Plan<'a>,
    /// The density.
    pub field: &'a Field<'a>,
    /// Column density beyond which nothing is seen.
    pub enough: f32,
    /// Columns and rows of pixels that may see the medium.
    pub window: [(usize, usize); 2],
    /// Where near lights are seen, in pixels.
    pub images: &'a [[f64; 2]],
    /// Paths per ray.
    pub starts: u64,
    /// Whether they begin at collisions drawn from a walk along the ray, or where it enters.
    pub walked: bool,
    pixels: Range<usize>,
    rays: Range<u64>,
}

impl Job<'_> {
    /// The pixel of view ray `at`, and its number among all view rays of all runs of the seed.
    pub fn sample(&self, at: usize) -> (usize, u64) {
        let [width, height] = self.plan.scene.camera.resolution;
        let rays = (self.rays.end - self.rays.start) as usize;
        let pixel = self.pixels.start + at / rays;
        let ray = self.rays.start + (at % rays) as u64;
        (pixel, ray * (width * height) as u64 + pixel as u64)
    }
}

/// The radiance that a view ray sees, by channel.
#[derive(Debug, Clone, Copy)]
pub struct Seen<const C: usize> {
    /// What all of it is to be multiplied by.
    pub share: f32,
    /// Scattered once. In double precision, so that the order in which paths end leaves no trace.
    pub one: [f64; C],
    /// Scattered more often.
    pub more: [f64; C],
}

impl<const C: usize> Seen<C> {
    /// Adds light of a scattering order.
    #[inline(always)]
    pub fn add(&mut self, order: u32, light: [f32; C]) {
        let sum = if order == 1 { &mut self.one } else { &mut self.more };
        for c in 0..C {
            sum[c] += f64::from(light[c]);
        }
    }
}

/// How the paths of a job are walked: one by one, or in lanes.
pub trait Tracer<const C: usize>: Sync {
    /// Walks all paths of a job, adding to what each of its view rays sees; gives the number of real collisions.
    fn trace(&self, job: &Job, seen: &mut [Seen<C>], halted: &(impl Fn() -> bool + Sync)) -> u64;
}

/// Sums over the view rays of a pixel.
#[derive(Debug, Clone, Copy)]
pub struct Sums<const C: usize> {
    one: [f64; C],
    all: [f64; C],
    square: [f64; C],
}

impl<const C: usize> Default for Sums<C> {
    fn default() -> Self {
        Sums { one: [0.0; C], all: [0.0; C], square: [0.0; C] }
    }
}

impl<const C: usize> Sums<C> {
    /// All values.
    pub fn values(&self) -> impl Iterator<Item = f64> {
        [self.one, self.all, self.square].into_iter().flatten()
    }

    /// From all values.
    fn from_slice(values: &[f64]) -> Self {
        let part = |k: usize| std::array::from_fn(|c| values[k * C + c]);
        Sums { one: part(0), all: part(1), square: part(2) }
    }

    /// Adds what a view ray sees: light that was scattered once, and more often.
    #[inline(always)]
    pub fn add(&mut self, one: [f64; C], more: [f64; C]) {
        for c in 0..C {
            let all = one[c] + more[c];
            self.one[c] += one[c];
            self.all[c] += all;
            self.square[c] += all * all;
        }
    }
}

/// What takes view rays of all pixels.
pub trait Passes<const C: usize> {
    /// View rays of each pixel that it takes in a pass, of which so many are planned.
    fn rays(&self, planned: u64) -> u64 {
        planned
    }

    /// Adds view rays of a range of numbers to all pixels' sums; gives the number of real collisions. What it leaves once
    /// `halted` said so is of no use.
    fn take(&self, rays: Range<u64>, sums: &mut [Sums<C>], halted: &(dyn Fn() -> bool + Sync)) -> Result<u64>;
}

/// What all view rays share.
pub struct Rays<'a> {
    /// The plan.
    pub plan: &'a Plan<'a>,
    /// How it traces paths.
    pub paths: &'a PathPlan,
    /// Columns and rows of pixels that may see the medium.
    pub window: [(usize, usize); 2],
    /// Where near lights are seen, in pixels.
    pub images: Vec<[f64; 2]>,
}

impl<'a> Rays<'a> {
    /// Those of a plan.
    pub fn new(plan: &'a Plan<'a>, connections: &Connections) -> Result<Self> {
        let Some(paths) = &plan.paths else { return Err(Error::Internal("the plan has no paths".into())) };
        let camera = &plan.scene.camera;
        let image = |light: &Light| match light {
            Light::Point { position, .. } if !connections.near.is_empty() => camera.project(*position),
            _ => None,
        };
        let volume = &plan.scene.medium.volume;
        let window = camera.window(volume.world([0.0; 3]), volume.size());
        Ok(Rays { plan, paths, window, images: plan.scene.lights.iter().filter_map(image).collect() })
    }
}

/// The view rays that were taken before an error.
#[derive(Debug, Clone)]
pub struct Taken {
    /// Sums over the rays of each pixel, by channel.
    sums: Vec<f64>,
    done: u64,
    goal: u64,
    collisions: u64,
}

/// Runs a plan for paths, or goes on with a run that an error cut short. The second value is there if this was cut short
/// too; what it had finished is the outcome then.
pub fn run(
    plan: &Plan,
    device: &Device,
    control: &Control,
    taken: Option<Taken>,
) -> Result<(Outcome, Option<(Error, Taken)>)> {
    let occupancy = Occupancy::new(&plan.scene.medium.volume);
    let occupancy = occupancy.as_ref();
    let columns = light_grids(plan, occupancy, control);
    let views = illuminations(plan.scene, occupancy, plan.lights.iter().map(|l| l.column), &columns);
    let field = Field::density(&plan.scene.medium.volume).skipping(occupancy);
    let connections = Connections::new(plan, field, &views);
    if control.stopped() {
        return Err(Error::Interrupted);
    }
    let rays = Rays::new(plan, &connections)?;
    let light_seconds = control.seconds();
    let (mut outcome, unfinished) = match device {
        Device::Cpu => match (plan.channels, plan.chromatic) {
            (1, _) => grey::<1>(&rays, &connections, &field, control, taken)?,
            (_, false) => grey::<3>(&rays, &connections, &field, control, taken)?,
            (_, true) => chromatic(&rays, &connections, &field, control, taken)?,
        },
        #[cfg(feature = "gpu")]
        Device::Gpu(gpu) => {
            let paths = gpu::path::Paths::new(gpu, &rays, &connections)?;
            match plan.channels {
                1 => passes::<1>(&rays, &paths, control, taken)?,
                _ => passes::<3>(&rays, &paths, control, taken)?,
            }
        }
    };
    outcome.seconds = [light_seconds, control.seconds() - light_seconds, 0.0];
    Ok((outcome, unfinished))
}

/// What a run of passes gives.
type Ended = Result<(Outcome, Option<(Error, Taken)>)>;

fn grey<const C: usize>(
    rays: &Rays,
    connections: &Connections,
    field: &Field,
    control: &Control,
    taken: Option<Taken>,
) -> Ended
where
    for<'a> Woodcock<'a, false>: track::Tracker<C>,
{
    let plan = rays.plan;
    if plan.lanes {
        let tracer = Laned::<C>::new(plan, connections);
        return passes::<C>(rays, &OnThreads::new(rays, tracer, connections, field), control, taken);
    }
    match (plan.tracker, &plan.majorant) {
        (Tracker::Woodcock, Some(grid)) => {
            one_by_one::<_, C>(Woodcock::<false>::new(plan, grid), rays, connections, field, control, taken)
        }
        (Tracker::Analytic, _) => {
            let sigma_t = plan.scene.medium.max_sigma_t() as f32;
            let tracker = Analytic { field: *field, sigma_t, score: plan.score, scores: false };
            one_by_one::<_, C>(tracker, rays, connections, field, control, taken)
        }
        _ => one_by_one::<_, C>(march::<false>(plan), rays, connections, field, control, taken),
    }
}

fn chromatic(rays: &Rays, connections: &Connections, field: &Field, control: &Control, taken: Option<Taken>) -> Ended {
    let plan = rays.plan;
    match &plan.majorant {
        Some(grid) => one_by_one::<_, 3>(Woodcock::<true>::new(plan, grid), rays, connections, field, control, taken),
        None => one_by_one::<_, 3>(march::<true>(plan), rays, connections, field, control, taken),
    }
}

fn march<'a, const CHROMATIC: bool>(plan: &Plan<'a>) -> March<'a, CHROMATIC> {
    let medium = &plan.scene.medium;
    let extinction = medium.extinction.rgb.map(|e| e as f32);
    March { field: Field::density(&medium.volume), extinction, scores: false }
}

fn one_by_one<'a, T: track::Tracker<C>, const C: usize>(
    tracker: T,
    rays: &'a Rays,
    connections: &'a Connections<'a>,
    field: &'a Field,
    control: &Control,
    taken: Option<Taken>,
) -> Ended {
    let medium = &rays.plan.scene.medium;
    let emission = medium.emission.as_ref();
    let fields = |glow: &Emission<'a>| (0..glow.channels()).map(|c| glow.field(c, &medium.volume)).collect();
    let emission = emission.map_or_else(Vec::new, fields);
    let density = Field::density(&medium.volume);
    let tracer = OneByOne { tracker, connections, medium: Medium::new(rays.plan.scene), density, emission };
    passes::<C>(rays, &OnThreads::new(rays, tracer, connections, field), control, taken)
}

/// View rays taken by all threads.
struct OnThreads<'a, T> {
    rays: &'a Rays<'a>,
    tracer: T,
    field: &'a Field<'a>,
    enough: f32,
}

impl<'a, T> OnThreads<'a, T> {
    fn new(rays: &'a Rays<'a>, tracer: T, connections: &Connections, field: &'a Field<'a>) -> Self {
        let least = connections.extinction.iter().copied().fold(f32::INFINITY, f32::min);
        OnThreads { rays, tracer, field, enough: 40.0 / least }
    }
}

impl<T: Tracer<C>, const C: usize> Passes<C> for OnThreads<'_, T> {
    fn take(&self, numbers: Range<u64>, sums: &mut [Sums<C>], halted: &(dyn Fn() -> bool + Sync)) -> Result<u64> {
        let Rays { plan, paths, window, images } = self.rays;
        let count = (numbers.end - numbers.start) as usize;
        let tile = (JOB / count).max(1);
        let collisions = AtomicU64::new(0);
        sums.par_chunks_mut(tile).enumerate().for_each_init(Vec::new, |seen, (at, sums)| {
            if halted() {
                return;
            }
            let first = at * tile;
            let job = Job {
                plan,
                field: self.field,
                enough: self.enough,
                window: *window,
                images,
                starts: paths.starts,
                walked: paths.walked,
                pixels: first..first + sums.len(),
                rays: numbers.clone(),
            };
            seen.clear();
            seen.resize(sums.len() * count, Seen { share: 0.0, one: [0.0; C], more: [0.0; C] });
            collisions.fetch_add(self.tracer.trace(&job, seen, &halted), Relaxed);
            for (sum, rays) in sums.iter_mut().zip(seen.chunks(count)) {
                for ray in rays {
                    let [one, more] = [ray.one, ray.more].map(|x| x.map(|x| x * f64::from(ray.share)));
                    sum.add(one, more);
                }
            }
        });
        Ok(collisions.into_inner())
    }
}

/// Takes pass after pass until the plan, the target, the clock or the user says stop.
fn passes<const C: usize>(rays: &Rays, taker: &impl Passes<C>, control: &Control, taken: Option<Taken>) -> Ended {
    let Rays { plan, paths, .. } = *rays;
    let [width, height] = plan.scene.camera.resolution;
    let mut sums = vec![Sums::<C>::default(); width * height];
    let dark = plan.orders == 0 || plan.scene.medium.max_albedo() == 0.0 || plan.scene.medium.max_sigma_t() == 0.0;
    let mut stopped = Stopped::Photons;
    let mut glow = None;
    let mut unfinished = None;
    let mut collisions = 0;
    let mut done = 0u64;
    let mut goal = paths.rays.unwrap_or(if plan.target_error.is_some() { ROUND } else { u64::MAX });
    if dark {
        (done, goal) = (1, 0);
    }
    if let Some(taken) = taken {
        (done, goal, collisions) = (taken.done, taken.goal, taken.collisions);
        sums = taken.sums.chunks_exact(3 * C).map(Sums::from_slice).collect();
    }
    'run: loop {
        while done < goal {
            let numbers = done..(done + taker.rays(paths.pass)).min(goal);
            // Two rays make an error bar: until then the clock does not cut a pass short.
            let urgent = done >= 2;
            let halted = || control.stopped() || (urgent && control.late());
            let before = if done > 0 { sums.clone() } else { Vec::new() };
            match taker.take(numbers.clone(), &mut sums, &halted) {
                Err(why) if done > 0 && why != Error::Interrupted => {
                    let flat = before.iter().flat_map(Sums::values).collect();
                    stopped = stopped_by(&why);
                    unfinished = Some((why, Taken { sums: flat, done, goal, collisions }));
                    sums = before;
                    break 'run;
                }
                met => collisions += met?,
            }
            if control.stopped() {
                return Err(Error::Interrupted);
            }
            if halted() {
                sums = before;
                stopped = if control.finishing() { Stopped::Progress } else { Stopped::TimeLimit };
                break 'run;
            }
            done = numbers.end;
            let scale = if paths.rays.is_none() && goal == ROUND { 0.1 } else { 1.0 };
            let part = if goal == u64::MAX { 0.0 } else { scale * done as f64 / goal as f64 };
            control.report(part.max(control.time_fraction()), done * paths.starts * (width * height) as u64);
            if done >= 2 && control.late() && done < goal {
                stopped = if control.finishing() { Stopped::Progress } else { Stopped::TimeLimit };
                break 'run;
            }
        }
        let Some(target) = plan.target_error.filter(|_| paths.rays.is_none() && !dark) else { break };
        let pixels = estimate(&sums, done);
        let sampled = pixels.order1.iter().zip(&pixels.order2).map(|(a, b)| a + b);
        let emitted = glow.get_or_insert_with(|| emitted(plan, control));
        let values: Vec<f32> = match emitted {
            Some(emitted) => sampled.zip(emitted).map(|(a, b)| a + *b).collect(),
            None => sampled.collect(),
        };
        let (noise, _) = pixel_error::relative(&values, &pixels.error, None, C);
        if noise <= target {
            stopped = Stopped::TargetError;
            break;
        }
        // Noise falls as the root of the rays; no more than eightfold at once, for it is itself an estimate.
        let factor = (noise * noise / (target * target) * 1.05).clamp(1.1, 8.0);
        goal = (done as f64 * factor).ceil() as u64;
    }
    let taken = if dark { 0 } else { done * paths.starts * (width * height) as u64 };
    let mut warnings = plan.warnings.clone();
    if taken > 0 && done == 1 {
        warnings.push("one view ray a pixel only: standard errors are not known (infinite)".into());
    }
    let outcome = Outcome {
        pixels: Some(estimate(&sums, done)),
        photons: taken,
        collisions,
        batches: done,
        degrees_of_freedom: done.saturating_sub(1),
        stopped,
        warnings,
        ..Outcome::default()
    };
    Ok((outcome, unfinished))
}

/// What the medium emits and is seen directly, which a target error counts in; `None` where it does not emit.
fn emitted(plan: &Plan, control: &Control) -> Option<Vec<f32>> {
    plan.scene.medium.emission.as_ref()?;
    let volumes = Volumes {
        scene: plan.scene,
        occupancy: None,
        lights: Vec::new(),
        source: None,
        source0: None,
        channels: plan.channels,
    };
    Some(image(&volumes, &plan.scene.camera, None, plan.channels, true, &|| control.stopped()).emitted)
}

/// Means and standard errors over `n` rays per pixel.
fn estimate<const C: usize>(sums: &[Sums<C>], n: u64) -> Pixels {
    let n = n as f64;
    let mut pixels = Pixels::default();
    for sum in sums {
        for c in 0..C {
            let (one, all) = (sum.one[c] / n, sum.all[c] / n);
            let variance = (sum.square[c] / n - all * all).max(0.0) / (n - 1.0);
            pixels.order1.push(one as f32);
            pixels.order2.push((all - one) as f32);
            pixels.error.push(if n > 1.0 {
                variance.sqrt() as f32
            } else if all > 0.0 {
                f32::INFINITY
            } else {
                0.0
            });
        }
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_means_and_their_standard_errors() {
        let rays = [(0.5, 0.5), (2.0, 0.0), (0.0, 4.0), (1.0, 7.0), (3.0, 2.0)];
        let mut sums = [Sums::<2>::default(); 2];
        for (one, more) in rays {
            sums[0].add([one, 2.0 * one], [more, 2.0 * more]);
            sums[1].add([one, 0.0], [more, 0.0]);
        }
        let pixels = estimate(&sums, 5);
        // Sums of 1, 2, 4, 8 and 5: mean 4, variance 30 / 4.
        let error = (30.0f64 / 4.0 / 5.0).sqrt() as f32;
        let near = |found: &[f32], truth: [f32; 4]| {
            assert!(
                found.iter().zip(truth).all(|(a, b)| (a - b).abs() < 1e-6 * b.max(1.0)),
                "{found:?}, not {truth:?}"
            );
        };
        near(&pixels.order1, [1.3, 2.6, 1.3, 0.0]);
        near(&pixels.order2, [2.7, 5.4, 2.7, 0.0]);
        near(&pixels.error, [error, 2.0 * error, error, 0.0]);
        assert_eq!(estimate(&sums[..1], 1).error, [f32::INFINITY; 2]);
    }
}
