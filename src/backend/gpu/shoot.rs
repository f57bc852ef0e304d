//! Photons on the GPU: a walk of many at once, dispatch after dispatch, each short beside a second.

use super::device::Gpu;
use super::emit::Start;
use super::kernel::{Binding, Kernel, Source};
use super::pace::{self, ITERATIONS};
use super::scene::{self, GpuScene};
use super::tally::Tally;
use super::tracker::Track;
use crate::backend::Control;
use crate::backend::cpu::course::{Course, Scored};
use crate::backend::cpu::emit::Emitter;
use crate::backend::cpu::energies::Energies;
use crate::backend::cpu::shoot::allot;
use crate::backend::shot::Shooter;
use crate::backend::shot::bin_units;
use crate::error::{Error, Result};
use crate::physics::harmonics::count;
use crate::plan::Plan;
use crate::result::Share;
use crate::tally::Bins;
use bytemuck::{Pod, Zeroable};
use std::sync::Arc;
use std::time::Instant;

/// Photons under way at once.
const SLOTS: u32 = 1 << 17;
/// The same where a processor plays the GPU.
const SOFTWARE_SLOTS: u32 = 1 << 12;
/// Events of a photon before slots whose photons have ended take their next ones.
const EVENTS: u32 = 16;
/// The same in flights, where photons are walked one by one.
const FLIGHTS: u32 = 4;

/// Copies of the counters in `shaders/counters.wgsl`.
pub const COPIES: usize = 64;
/// Words of a copy.
pub const WORDS: usize = 72;
/// Where real collisions are counted.
pub const COLLISIONS: usize = 66;
/// Where photons that are done are counted.
pub const FINISHED: usize = 68;

/// `Job` of `shaders/photons.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[expect(missing_docs, reason = "the shader names and describes them")]
pub struct Job {
    pub slots: u32,
    pub rounds: u32,
    pub spare: [u32; 2],
    pub units: [f32; 3],
    pub padding: u32,
}

/// Bytes of `Photon` of `shaders/photons.wgsl`, with all that it may hold.
const PHOTON: u64 = 160;

/// Shoots the photons of some emitters on a GPU.
pub struct Shooting<'a> {
    gpu: &'a Gpu,
    plan: &'a Plan<'a>,
    scene: GpuScene,
    emitters: Vec<(Start, Arc<Kernel>, u32)>,
    majorants: wgpu::Buffer,
    scores: wgpu::Buffer,
    job: wgpu::Buffer,
    photons: wgpu::Buffer,
    counters: wgpu::Buffer,
    fates: Option<wgpu::Buffer>,
    tally: Tally,
    bins: Vec<Vec<Bins>>,
    slots: u32,
    /// Rounds of a dispatch.
    rounds: u32,
    /// What every bin begins with, to test what happens at its ends.
    #[cfg(test)]
    preset: Option<u64>,
}

impl<'a> Shooting<'a> {
    /// Compiles the kernels of a plan, and uploads what they read.
    pub fn new(gpu: &'a Gpu, plan: &'a Plan<'a>, emitters: &[Emitter]) -> Result<Self> {
        Self::watching(gpu, plan, emitters, 0)
    }

    /// The same; the fates of the first `watched` photons of an emitter are kept.
    pub fn watching(gpu: &'a Gpu, plan: &'a Plan<'a>, emitters: &[Emitter], watched: usize) -> Result<Self> {
        let mut on_gpu = GpuScene::new(gpu, plan.scene, plan.channels)?;
        let (flights, events, iterations) = flights(plan);
        on_gpu.update(gpu, |constants| {
            scene::of_plan(plan, constants);
            (constants.free_path, constants.block, constants.cells) = (flights.free_path, flights.block, flights.cells);
        });
        let values = (plan.scene.medium.volume.voxels() * plan.channels) as u64;
        let widths: Vec<u64> = plan.layers.iter().map(|layer| values * plan.width_of(*layer) as u64).collect();
        let total: u64 = widths.iter().sum();
        let mut ready = Vec::with_capacity(emitters.len());
        for emitter in emitters {
            let start = Start::new(gpu, plan.scene, emitter)?;
            let source = source(plan, &on_gpu, &flights, &start, watched > 0);
            let source = Tally::layout(gpu, total, source);
            let round = 1 + start.iterations + 2 * plan.channels as u32 + events * iterations;
            let limit = ITERATIONS / round;
            ready.push((start, gpu.kernel(source)?, limit.max(1)));
        }
        let slots = if gpu.software { SOFTWARE_SLOTS } else { SLOTS }.min(plan.batch_photons.max(1) as u32);
        let new = |bins: &u64| vec![Bins::new(*bins as usize, true)];
        Ok(Shooting {
            gpu,
            plan,
            scene: on_gpu,
            emitters: ready,
            majorants: gpu.buffer(&flights.majorants)?,
            scores: gpu.buffer(&flights.scores)?,
            job: gpu.uniform(&Job::zeroed())?,
            photons: gpu.empty(u64::from(slots) * PHOTON)?,
            counters: gpu.empty((COPIES * WORDS * 4) as u64)?,
            fates: if watched > 0 { Some(gpu.empty(watched as u64 * 8)?) } else { None },
            tally: Tally::new(gpu, total)?,
            bins: widths.iter().map(new).collect(),
            slots,
            rounds: 8,
            #[cfg(test)]
            preset: None,
        })
    }

    /// Walks all photons of an emitter; false if it was halted.
    fn walk(&mut self, at: usize, photons: u64, halted: impl Fn() -> bool) -> Result<bool> {
        let (start, kernel, limit) = &self.emitters[at];
        let slots = self.slots.min(photons as u32);
        // All slots are new.
        self.gpu.clear(&self.photons);
        let mut bindings = self.scene.bindings();
        bindings.extend(start.bindings());
        bindings.extend([
            ("job", Binding::Buffer(&self.job)),
            ("photons", Binding::Buffer(&self.photons)),
            ("counters", Binding::Buffer(&self.counters)),
            ("majorants", Binding::Buffer(&self.majorants)),
            ("cell_scores", Binding::Buffer(&self.scores)),
        ]);
        bindings.extend(self.tally.bindings());
        bindings.extend(self.fates.iter().map(|buffer| ("fates", Binding::Buffer(buffer))));
        let before = self.finished()?;
        loop {
            if halted() {
                return Ok(false);
            }
            let rounds = self.rounds.min(*limit);
            let units = bin_units(self.plan).map(|unit| unit as f32);
            let job = Job { slots, rounds, spare: [0; 2], units, padding: 0 };
            self.gpu.write(&self.job, 0, &[job]);
            let began = Instant::now();
            self.gpu.run(kernel, &bindings, u64::from(slots))?;
            if self.finished()? - before >= photons {
                return Ok(true);
            }
            self.rounds = pace::next(rounds, began, ITERATIONS);
        }
    }

    /// Photons of this batch that are done.
    fn finished(&self) -> Result<u64> {
        let counters: Vec<u32> = self.gpu.read(&self.counters, COPIES * WORDS)?;
        Ok(counters.chunks(WORDS).map(|copy| u64::from(copy[FINISHED])).sum())
    }

    /// Where the energy of the batch went.
    fn energies(&self) -> Result<Energies> {
        let counters: Vec<u32> = self.gpu.read(&self.counters, COPIES * WORDS)?;
        let wide = |copy: &[u32], at: usize| (u64::from(copy[at]) | u64::from(copy[at + 1]) << 32) as i64;
        let of = |copy: &[u32]| {
            let mut shares = [[0i64; 3]; Share::COUNT];
            for (at, share) in shares.as_flattened_mut().iter_mut().enumerate() {
                *share = wide(copy, 2 * at);
            }
            Energies::from_units(shares, wide(copy, COLLISIONS) as u64)
        };
        let energies = counters.chunks(WORDS).map(of).fold(Energies::default(), Energies::merge);
        // No batch adds as much as would lead a copy from here past the sign.
        energies.checked()
    }

    /// Collisions, and the share of the energy that it ended in, of each watched photon.
    pub fn fates(&self, watched: usize) -> Result<Vec<[u32; 2]>> {
        self.fates.as_ref().map_or(Ok(Vec::new()), |buffer| self.gpu.read(buffer, watched))
    }
}

impl Shooter for Shooting<'_> {
    fn batch(&mut self, first: u64, photons: u64, control: &Control, urgent: bool) -> Result<Option<Energies>> {
        self.gpu.clear(&self.counters);
        self.tally.clear(self.gpu);
        #[cfg(test)]
        self.tally.fill(self.gpu, self.preset.unwrap_or(0));
        let powers: Vec<[f64; 3]> = self.emitters.iter().map(|e| e.0.powers).collect();
        let mut from = first;
        for (at, (count, scale)) in allot(&powers, photons).into_iter().enumerate() {
            self.emitters[at].0.begin(self.gpu, from, count, scale);
            if !self.walk(at, count, || control.stopped() || (urgent && control.late()))? {
                return Ok(None);
            }
            from += count;
        }
        self.energies().map(Some)
    }

    fn bins(&mut self) -> Result<&mut [Vec<Bins>]> {
        let [low, high] = self.tally.read(self.gpu)?;
        // No batch adds as much as would lead from here past the sign.
        if high.iter().any(|&word| (word as i32).unsigned_abs() >= 1 << 30) {
            return Err(Error::Internal("a tally bin exceeded 2^62 units".into()));
        }
        let mut from = 0;
        for layer in &mut self.bins {
            let end = from + layer[0].len();
            layer[0].load(&low[from..end], &high[from..end]);
            from = end;
        }
        Ok(&mut self.bins)
    }
}

/// The flights of a plan, with the shader that walks photons; events of a round, and loop iterations that each may take.
fn flights(plan: &Plan) -> (Track, u32, u32) {
    let channels = plan.channels as u32;
    let score =
        channels * (1 + u32::from(plan.absorbed.is_some()) + plan.harmonics.map_or(1, |order| count(order) as u32));
    let (mut track, file, events) = if plan.lanes {
        let voxels = plan.settings.fluence || plan.settings.radiance;
        let scored = if voxels { Scored::Everywhere } else { Scored::ForImages };
        (Track::by_events(&Course::new(plan, scored, 0)), "shoot", EVENTS)
    } else {
        (Track::new(plan, if plan.layers.is_empty() { 0 } else { score }), "shoot_one", FLIGHTS)
    };
    track.files.insert(0, file);
    track.constants.extend([("EVENTS", f64::from(events)), ("APART", f64::from(u8::from(!plan.lanes)))]);
    let iterations = track.iterations + score + channels;
    (track, events, iterations)
}

/// The kernel of an emitter.
fn source(plan: &Plan, scene: &GpuScene, flights: &Track, start: &Start, watched: bool) -> Source {
    let mut files = flights.files.clone();
    files.extend([
        "flight_state",
        "face",
        "eye",
        "roulette",
        "photons",
        "counters",
        "tally",
        "tally_whole",
        "tally_parts",
        "deposit",
        "harmonics",
    ]);
    files.push(if watched { "end_fate" } else { "end_nothing" });
    files.push(match plan.harmonics {
        Some(_) => "angular_harmonics",
        None if plan.routes.iter().any(|route| route.1.is_some()) => "angular_eye",
        None => "angular_nothing",
    });
    files.extend(&start.files);
    let first = |layer: Option<usize>| {
        let before = |at: usize| plan.layers[..at].iter().map(|&layer| plan.width_of(layer)).sum::<usize>() as u32;
        layer.map_or(u32::MAX, before)
    };
    let unscattered = if start.tallies_unscattered { plan.routes[0] } else { (None, None) };
    let source = scene
        .source(&files)
        .with("UNLIMITED", plan.walked_orders() == u32::MAX)
        .with("ORDER", plan.harmonics.unwrap_or(0) as u32)
        .with("HATS", plan.scene.medium.volume.linear())
        .with("PLAIN_FIRST", first(unscattered.0))
        .with("PLAIN_INNER", first(plan.routes[1].0))
        .with("PLAIN_LAST", first(plan.routes[2].0))
        .with("ANGULAR_FIRST", first(unscattered.1))
        .with("ANGULAR_INNER", first(plan.routes[1].1))
        .with("ANGULAR_LAST", first(plan.routes[2].1))
        .with("ABSORBED_FIRST", first(plan.absorbed));
    flights.constants.iter().fold(start.set(source), |source, (name, value)| source.with(name, *value))
}

#[cfg(test)]
mod tests;
