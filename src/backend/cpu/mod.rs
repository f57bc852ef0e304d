//! The CPU backend: runs a plan on all cores, with the same bits for any number of threads.

pub mod angular;
pub mod collision_medium;
pub mod course;
pub mod emit;
pub mod emitted;
pub mod energies;
mod even;
pub mod flights;
pub mod gather;
pub mod lanes;
pub mod light;
pub mod path;
pub mod pixel_error;
pub mod settle;
pub mod shoot;
pub mod simd;
mod sweep;
pub mod track;
pub mod unscattered;

use crate::backend::Control;
use crate::backend::shot::Shooter;
use crate::backend::shot::bin_units;
use crate::error::{Error, Result};
use crate::plan::{Layer, Plan, Tracker, cost};
use crate::scene::field::Field;
use crate::tally::Bins;
use emit::Emitter;
use energies::Energies;
use lanes::Laned;
use rayon::ThreadPool;
use shoot::{Engine, OneByOne, Walk};
use track::{Analytic, March, Woodcock};

/// A pool of the given number of threads, for one call. None is kept, nor is the one used that rayon has for all: a process
/// that forks leaves its threads behind, and who waits for one of a pool then waits for ever.
pub fn pool(threads: Option<usize>) -> Result<ThreadPool> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(cost::threads(threads))
        .build()
        .map_err(|e| Error::Internal(format!("the threads could not be started: {e}")))
}

/// Runs `work` on a pool of the given number of threads: the one that this is called from, if it has as many.
pub fn with_threads<T: Send>(threads: Option<usize>, work: impl FnOnce() -> T + Send) -> Result<T> {
    if rayon::current_thread_index().is_some() && rayon::current_num_threads() == cost::threads(threads) {
        return Ok(work());
    }
    Ok(pool(threads)?.install(work))
}

/// Shoots on all cores.
struct Shooting<'a, E> {
    engine: E,
    walk: Walk<'a>,
    bins: Vec<Vec<Bins>>,
}

impl<E: Engine> Shooter for Shooting<'_, E> {
    fn batch(&mut self, first: u64, photons: u64, control: &Control, urgent: bool) -> Result<Option<Energies>> {
        self.walk.bins = std::mem::take(&mut self.bins);
        let finished = self.walk.batch(&self.engine, first, photons, control, urgent);
        self.bins = std::mem::take(&mut self.walk.bins);
        finished.map(Energies::checked).transpose()
    }

    fn bins(&mut self) -> Result<&mut [Vec<Bins>]> {
        Ok(&mut self.bins)
    }
}

/// Shoots the photons of some emitters on all cores.
pub fn shooter<'a>(plan: &'a Plan<'a>, emitters: &'a [Emitter<'a>]) -> Box<dyn Shooter + 'a> {
    match plan.channels {
        1 => shoot_grey::<1>(plan, emitters),
        _ if plan.chromatic => shoot_chromatic(plan, emitters),
        _ => shoot_grey::<3>(plan, emitters),
    }
}

fn shooting<'a>(plan: &'a Plan<'a>, emitters: &'a [Emitter<'a>], engine: impl Engine + 'a) -> Box<dyn Shooter + 'a> {
    let values = plan.scene.medium.volume.voxels() * plan.channels;
    let sets = cost::bin_sets(plan);
    let new = |layer: &Layer| Bins::new(values * plan.width_of(*layer), sets == 1);
    let bins = plan.layers.iter().map(|layer| (0..sets).map(|_| new(layer)).collect()).collect();
    let walk = Walk { plan, emitters, bins: Vec::new(), sets, units: bin_units(plan).map(|unit| unit as f32) };
    Box::new(Shooting { engine, walk, bins })
}

fn shoot_grey<'a, const C: usize>(plan: &'a Plan<'a>, emitters: &'a [Emitter<'a>]) -> Box<dyn Shooter + 'a>
where
    for<'b> Woodcock<'b, false>: track::Tracker<C>,
{
    let medium = &plan.scene.medium;
    let field = Field::density(&medium.volume);
    let scores = !plan.layers.is_empty();
    let extinction = medium.extinction.rgb;
    if plan.lanes {
        return shooting(plan, emitters, Laned::<C>::new(plan));
    }
    match (plan.tracker, &plan.majorant) {
        (Tracker::Woodcock, Some(grid)) => {
            let tracker = Woodcock::<false>::new(plan, grid);
            shooting(plan, emitters, OneByOne::<_, C>(tracker))
        }
        (Tracker::Analytic, _) => {
            let sigma_t = medium.max_sigma_t() as f32;
            let tracker = Analytic { field, sigma_t, score: plan.score, scores };
            shooting(plan, emitters, OneByOne::<_, C>(tracker))
        }
        _ => {
            let tracker = March::<false> { field, extinction: extinction.map(|e| e as f32), scores };
            shooting(plan, emitters, OneByOne::<_, C>(tracker))
        }
    }
}

fn shoot_chromatic<'a>(plan: &'a Plan<'a>, emitters: &'a [Emitter<'a>]) -> Box<dyn Shooter + 'a> {
    let medium = &plan.scene.medium;
    let field = Field::density(&medium.volume);
    let scores = !plan.layers.is_empty();
    let extinction = medium.extinction.rgb;
    match &plan.majorant {
        Some(grid) => {
            let tracker = Woodcock::<true>::new(plan, grid);
            shooting(plan, emitters, OneByOne::<_, 3>(tracker))
        }
        None => {
            let tracker = March::<true> { field, extinction: extinction.map(|e| e as f32), scores };
            shooting(plan, emitters, OneByOne::<_, 3>(tracker))
        }
    }
}
