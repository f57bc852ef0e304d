//! The photon walk: starts, flights, scatterings, and what they leave in the tallies.

use super::collision_medium::Medium;
use super::emit::{Emitter, Start};
use super::energies::Energies;
use super::track::{Flight, Scorer, Tracker, Weights};
use crate::backend::Control;
use crate::physics::Phase;
use crate::physics::frame::rotate;
use crate::physics::harmonics::{MAX_ORDER, count, evaluate};
use crate::physics::rng::{Draws, rounding, split, uniform, uniform64};
use crate::plan::{Plan, Route};
use crate::result::{EXIT_FACES, Share};
use crate::scene::field::V3;
use crate::tally::Bins;
use rayon::prelude::*;
use std::ops::Range;

/// Collisions between looks at the clock and the stop flag within one photon.
const PATIENCE: u32 = 1 << 14;
/// Below this weight a photon plays roulette, and survives with the chance `SURVIVAL`.
pub const ROULETTE: f32 = 0.1;
/// A power of two, which two random bits decide.
pub const SURVIVAL: f32 = 0.25;

/// What all photons of a run share.
pub struct Walk<'a> {
    /// The plan.
    pub plan: &'a Plan<'a>,
    /// What shoots.
    pub emitters: &'a [Emitter<'a>],
    /// The bins of each tally layer: one set per thread, or one for all.
    pub bins: Vec<Vec<Bins>>,
    /// Sets of bins in each layer.
    pub sets: usize,
    /// Bin units per weight * length, by channel.
    pub units: [f32; 3],
}

/// Photons that one thread walks without looking up: those of one emitter, all of the same power by channel.
pub struct Task<'a> {
    /// Where they start.
    pub emitter: &'a Emitter<'a>,
    /// The power of each over that of the batch's mean photon, by channel.
    pub scale: [f32; 3],
    /// Number of the emitter's first photon in the run.
    pub first: u64,
    /// Photons of the emitter in this batch.
    pub count: u64,
    /// Which of these.
    pub range: Range<u64>,
}

impl Task<'_> {
    /// The draws of the photon `j` of the emitter, and its start.
    #[inline(always)]
    pub fn start(&self, seed: [u32; 2], j: u64) -> (Draws, Start) {
        let mut draws = Draws::new(seed, self.first + j, 0);
        let u = (j as f64 + uniform64(draws.next4()[0])) / self.count as f64;
        let start = self.emitter.start(u, &mut draws);
        (draws, start)
    }
}

/// How the photons of a task are walked: one by one, or in lanes.
pub trait Engine: Sync {
    /// Photons of a task.
    const TASK: u64;
    /// Walks a task.
    fn task(&self, walk: &Walk, task: &Task, energies: &mut Energies, halted: &(impl Fn() -> bool + Sync));
}

/// The numbers of photons that the emitters get of `photons`, and the power of each of these over that of the mean photon,
/// by channel. An emitter gets as many as its part of the power says, in the channel where that is largest: a channel
/// that one weak lamp fills alone has photons as others have. One at least, rounded so that the sum is right.
pub fn allot(powers: &[[f64; 3]], photons: u64) -> Vec<(u64, [f32; 3])> {
    let totals = total(powers);
    let part = |power: &[f64; 3], c: usize| if totals[c] > 0.0 { power[c] / totals[c] } else { 0.0 };
    let shares: Vec<f64> = powers.iter().map(|p| (0..3).map(|c| part(p, c)).fold(0.0, f64::max)).collect();
    let sum: f64 = shares.iter().sum();
    let spare = photons - powers.len() as u64;
    let (mut cumulative, mut before) = (0.0, 0);
    let mut given = Vec::with_capacity(powers.len());
    for (at, power) in powers.iter().enumerate() {
        cumulative += shares[at];
        let last = at + 1 == powers.len();
        let upto = if last { spare } else { ((cumulative / sum * spare as f64).round() as u64).min(spare) };
        let count = 1 + upto - before;
        given.push((count, std::array::from_fn(|c| (part(power, c) * (photons as f64 / count as f64)) as f32)));
        before = upto;
    }
    given
}

/// The power of all emitters [W], by channel.
pub fn total(powers: &[[f64; 3]]) -> [f64; 3] {
    std::array::from_fn(|c| powers.iter().map(|power| power[c]).sum())
}

impl Walk<'_> {
    /// Walks the photons of one batch, `first` being the number of its first; `None` if it was stopped.
    pub fn batch(
        &self,
        engine: &impl Engine,
        first: u64,
        photons: u64,
        control: &Control,
        urgent: bool,
    ) -> Option<Energies> {
        let powers: Vec<[f64; 3]> = self.emitters.iter().map(|e| e.powers).collect();
        let mut tasks = Vec::new();
        let mut from = first;
        for (emitter, (count, scale)) in self.emitters.iter().zip(allot(&powers, photons)) {
            tasks.extend(pieces(count, engine).map(|range| Task { emitter, scale, first: from, count, range }));
            from += count;
        }
        let halted = || control.stopped() || (urgent && control.late());
        let energies = tasks
            .into_par_iter()
            .map(|task| {
                let mut energies = Energies::default();
                if !halted() {
                    engine.task(self, &task, &mut energies, &halted);
                }
                energies
            })
            .reduce(Energies::default, Energies::merge);
        (!halted()).then_some(energies)
    }

    /// The set of bins that this thread adds to.
    pub fn set(&self) -> usize {
        rayon::current_thread_index().unwrap_or(0) % self.sets
    }
}

/// The tasks that `count` photons are cut into: short enough that all threads end together.
fn pieces<E: Engine>(count: u64, _: &E) -> impl Iterator<Item = Range<u64>> {
    let fair = count.div_ceil(8 * rayon::current_num_threads() as u64);
    let size = fair.clamp(256.min(E::TASK), E::TASK);
    (0..count).step_by(size as usize).map(move |at| at..(at + size).min(count))
}

/// Photons walked one by one: the truth that lanes are compared with, and what all trackers and spectral weights have.
pub struct OneByOne<T, const C: usize>(pub T);

impl<const C: usize, T: Tracker<C>> Engine for OneByOne<T, C> {
    const TASK: u64 = 256;

    fn task(&self, walk: &Walk, task: &Task, energies: &mut Energies, halted: &(impl Fn() -> bool + Sync)) {
        for j in task.range.clone() {
            let (mut draws, start) = task.start(split(walk.plan.settings.seed), j);
            self.photon(walk, task, start, &mut draws, energies, halted);
        }
    }
}

impl<const C: usize, T: Tracker<C>> OneByOne<T, C> {
    /// Walks one photon to its end.
    #[inline(always)]
    fn photon(
        &self,
        walk: &Walk,
        task: &Task,
        start: Start,
        draws: &mut Draws,
        energies: &mut Energies,
        halted: &impl Fn() -> bool,
    ) {
        let (plan, emitter, scale) = (walk.plan, task.emitter, task.scale);
        let phase = &plan.scene.medium.phase;
        let last = plan.walked_orders();
        let medium = Medium::new(plan.scene);
        let colour: [f32; C] = std::array::from_fn(|c| scale[c]);
        let hero = if plan.chromatic { draws.next4()[0] } else { 0 };
        let mut order = 0u32;
        let mut collisions = 0u32;
        let (mut w, mut p, mut direction, mut at_collision) = match start {
            Start::Miss => return energies.add(Share::Missed, colour, rounding(draws.next4()[0])),
            Start::Flight { p, direction } => (Weights::new(colour, hero), p, direction, false),
            Start::Coloured { p, direction, weight } => {
                (Weights::new(std::array::from_fn(|c| weight[c] * scale[c]), hero), p, direction, false)
            }
            Start::Collision { p, direction, weight } => {
                (Weights::new(std::array::from_fn(|c| weight[c] * scale[c]), hero), p, direction, true)
            }
        };
        let mut scorer = Scores {
            bins: &walk.bins,
            set: walk.set(),
            units: walk.units,
            route: (None, None),
            absorbed: plan.absorbed,
            medium: &medium,
            phase,
            harmonics: plan.harmonics,
            y: [0.0; count(MAX_ORDER)],
            direction,
        };
        loop {
            if !at_collision {
                scorer.direction = direction;
                if let Some(order) = plan.harmonics {
                    evaluate(direction, order, &mut scorer.y);
                }
                scorer.route = match order {
                    0 if emitter.tallies_unscattered => plan.routes[0],
                    0 => (None, None),
                    n if n == last => plan.routes[2],
                    _ => plan.routes[1],
                };
                let v = std::array::from_fn(|a| direction[a] * medium.inverse_h[a]);
                match self.0.fly(p, v, &mut w, draws, &mut scorer) {
                    Flight::Exit(face) => {
                        let share = if order == 0 { Share::Unscattered } else { EXIT_FACES[face] };
                        energies.add(share, w.get(), rounding(draws.next4()[0]));
                        break;
                    }
                    Flight::Collision(at) => p = at,
                }
            }
            at_collision = false;
            collisions += 1;
            let words = draws.next4();
            let before = w.get();
            let albedo: [f32; C] = medium.albedo(p, words[2]);
            for c in 0..C {
                w.value[c] *= albedo[c];
            }
            let after = w.get();
            // The azimuth's word: nothing that this collision leaves depends on it.
            let xi = rounding(words[1]);
            energies.add::<C>(Share::Absorbed, std::array::from_fn(|c| before[c] - after[c]), xi);
            let top = after.iter().fold(0.0, |m: f32, &x| m.max(x));
            if top <= 0.0 {
                break;
            }
            if order >= last {
                energies.add(Share::Truncated, after, xi);
                break;
            }
            order += 1;
            if last == u32::MAX && top < ROULETTE {
                if uniform(words[3]) > SURVIVAL {
                    energies.add(Share::Roulette, after, xi);
                    break;
                }
                w.value = w.value.map(|x| x * (1.0 / SURVIVAL));
                let grown = w.get();
                energies.add::<C>(Share::Roulette, std::array::from_fn(|c| after[c] - grown[c]), xi);
            }
            let (cos_theta, sin_theta) = phase.sample(uniform(words[0]));
            direction = rotate(direction, cos_theta, sin_theta, uniform(words[1]));
            if collisions.is_multiple_of(PATIENCE) && halted() {
                break;
            }
        }
        energies.collisions += u64::from(collisions);
    }
}

/// Scores a flight into the layers that its order goes to.
struct Scores<'a> {
    bins: &'a [Vec<Bins>],
    set: usize,
    units: [f32; 3],
    route: Route,
    absorbed: Option<usize>,
    medium: &'a Medium<'a>,
    phase: &'a Phase,
    harmonics: Option<usize>,
    /// The harmonics of the direction.
    y: [f32; count(MAX_ORDER)],
    direction: V3,
}

impl<const C: usize> Scorer<C> for Scores<'_> {
    #[inline(always)]
    fn score(&mut self, index: usize, p: V3, value: [f32; C], xi: f32) {
        if let Some(layer) = self.route.0 {
            for c in 0..C {
                self.bins[layer][self.set].add(index * C + c, value[c] * self.units[c], xi);
            }
        }
        if let (Some(layer), Some(order)) = (self.route.1, self.harmonics) {
            let k = count(order);
            for at in 0..k * C {
                let units = value[at % C] * self.units[at % C] * self.y[at / C];
                self.bins[layer][self.set].add(index * k * C + at, units, xi);
            }
        } else if let Some(layer) = self.route.1 {
            let to_eye = self.medium.eye.from(p, self.medium.h);
            let cos_theta = (0..3).map(|a| to_eye[a] * self.direction[a]).sum::<f32>().clamp(-1.0, 1.0);
            let seen = self.phase.pdf(cos_theta);
            for c in 0..C {
                self.bins[layer][self.set].add(index * C + c, value[c] * self.units[c] * seen, xi);
            }
        }
    }

    #[inline(always)]
    fn absorbs(&self) -> bool {
        self.absorbed.is_some() && self.route.0.is_some()
    }

    #[inline(always)]
    fn absorb(&mut self, index: usize, p: V3, density: f32, value: [f32; C], xi: f32) {
        let Some(layer) = self.absorbed else { return };
        let absorbed = self.medium.relative_absorption(p, density);
        for c in 0..C {
            self.bins[layer][self.set].add(index * C + c, value[c] * self.units[c] * absorbed, xi);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn allotted_photons_add_up() {
        for (powers, photons) in
            [(vec![1.0, 2.0, 3.0], 1000), (vec![1e-9, 1.0], 2), (vec![5.0], 17), (vec![1.0; 7], 100)]
        {
            let powers: Vec<[f64; 3]> = powers.into_iter().map(|power| [power; 3]).collect();
            let given = allot(&powers, photons);
            assert_eq!(given.iter().map(|g| g.0).sum::<u64>(), photons);
            assert!(given.iter().all(|g| g.0 > 0));
            // The mean photon has the weight 1.
            let mean = given.iter().map(|g| g.0 as f64 * f64::from(g.1[0])).sum::<f64>() / photons as f64;
            assert!((mean - 1.0).abs() < 1e-6, "{mean}");
        }
    }

    #[test]
    fn a_channel_that_a_weak_lamp_fills_alone_has_photons() {
        let given = allot(&[[1.0, 1.0, 0.0], [0.0, 0.0, 1e-20]], 1000);
        assert_eq!(given, [(500, [2.0, 2.0, 0.0]), (500, [0.0, 0.0, 2.0])]);
    }

    #[test]
    fn no_photon_weighs_more_than_a_few_mean_ones() {
        for w in [1.0, 1e-3, 1e-9, 1e-25] {
            for powers in
                [vec![[1.0, w, w * w], [w, 1.0, w], [w, w, w]], vec![[1.0; 3], [w; 3]], vec![[w, 0.0, 0.0]; 9]]
            {
                for photons in [powers.len() as u64, 20, 1000, 1 << 24] {
                    let most = 2.0 * powers.len().max(3) as f32;
                    let given = allot(&powers, photons);
                    assert!(
                        given.iter().all(|(_, scale)| scale.iter().all(|&s| s <= most)),
                        "{w} {photons}: {given:?}"
                    );
                }
            }
        }
    }
}
