//! The photon walk: starts, flights, scatterings, and what they leave in the tallies.

use super::emit::{Emitter, Start};
use super::track::{Flight, Scorer, Tracker, Weights};
use crate::backend::Control;
use crate::error::{Error, Result};
use crate::physics::Phase;
use crate::physics::frame::rotate;
use crate::physics::harmonics::{MAX_ORDER, count, evaluate};
use crate::physics::rng::{Draws, rounding, split, uniform, uniform64};
use crate::plan::{Plan, Route};
use crate::result::{EXIT_FACES, Share};
use crate::scene::camera::Eye;
use crate::scene::field::{Field, V3};
use crate::scene::{Albedo, Camera, Scene};
use crate::tally::{Bins, rounded};
use rayon::prelude::*;
use std::ops::Range;

/// Fixed-point unit of energies: weights of 1 are 2^36 units. Those of a batch, whose mean is 1 at the start, stay far
/// within 63 bits: [`crate::plan::LARGEST_BATCH`].
const ENERGY_UNIT: f32 = 68_719_476_736.0;
/// Collisions between looks at the clock and the stop flag within one photon.
const PATIENCE: u32 = 1 << 14;
/// Below this weight a photon plays roulette, and survives with the chance `SURVIVAL`.
pub const ROULETTE: f32 = 0.1;
/// A power of two, which two random bits decide.
pub const SURVIVAL: f32 = 0.25;

/// What happened to the energy of the photons of a task or batch, in fixed point: sums are the same in any order.
#[derive(Debug, Clone, Copy)]
pub struct Energies {
    shares: [[i64; 3]; Share::COUNT],
    /// Whether a sum left the range of its integer.
    overflowed: bool,
    /// Real collisions.
    pub collisions: u64,
}

impl Default for Energies {
    fn default() -> Self {
        Energies { shares: [[0; 3]; Share::COUNT], overflowed: false, collisions: 0 }
    }
}

impl Energies {
    /// Sums of shares by channel in 2^-36 of a weight, and real collisions.
    pub fn from_units(shares: [[i64; 3]; Share::COUNT], collisions: u64) -> Self {
        Energies { shares, overflowed: false, collisions }
    }

    /// Adds a weight to a share; `xi` rounds.
    #[inline(always)]
    pub fn add<const C: usize>(&mut self, share: Share, weight: [f32; C], xi: f32) {
        for c in 0..C {
            self.add_units(share.index(), c, rounded(weight[c] * ENERGY_UNIT, xi));
        }
    }

    #[inline(always)]
    fn add_units(&mut self, share: usize, channel: usize, units: i64) {
        let (sum, overflowed) = self.shares[share][channel].overflowing_add(units);
        self.shares[share][channel] = sum;
        self.overflowed |= overflowed;
    }

    /// The sums of both.
    pub fn merge(mut self, other: Self) -> Self {
        for share in 0..Share::COUNT {
            for channel in 0..3 {
                self.add_units(share, channel, other.shares[share][channel]);
            }
        }
        self.overflowed |= other.overflowed;
        self.collisions += other.collisions;
        self
    }

    /// Itself, or an error where a sum ever left its range.
    pub fn checked(self) -> Result<Self> {
        if self.overflowed {
            return Err(Error::Internal("the energies of a batch exceeded 2^63 units".into()));
        }
        Ok(self)
    }

    /// The sum in a share and channel, in weights.
    pub fn get(&self, share: Share, channel: usize) -> f64 {
        self.shares[share.index()][channel] as f64 / f64::from(ENERGY_UNIT)
    }
}

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

/// What a photon needs of the medium at a collision.
pub struct Medium<'a> {
    /// The albedo by channel, where it is constant.
    pub constant: [f32; 3],
    /// The albedo's field, where it is not.
    pub field: Option<Field<'a>>,
    /// 1 / the largest density.
    per_density: f32,
    /// Spacing.
    pub h: V3,
    /// Voxels per length.
    pub inverse_h: V3,
    /// Where anisotropic media are recorded towards.
    pub eye: LocalEye,
}

impl<'a> Medium<'a> {
    /// That of a scene.
    #[inline(always)]
    pub fn new(scene: &'a Scene<'a>) -> Self {
        let medium = &scene.medium;
        let h = medium.volume.spacing();
        let (constant, field) = match medium.albedo {
            Albedo::Constant(a) => (a.rgb.map(|x| x as f32), None),
            Albedo::PerVoxel(values) => ([0.0; 3], Some(Field::new(values, &medium.volume))),
        };
        Medium {
            constant,
            field,
            per_density: 1.0 / medium.volume.max().max(1e-30),
            h: h.map(|c| c as f32),
            inverse_h: h.map(|c| (1.0 / c) as f32),
            eye: LocalEye::new(scene, &scene.camera),
        }
    }

    /// The albedo at a point; a per-voxel one by a read whose mean it is, which is unbiased as weights are linear in it.
    #[inline(always)]
    pub fn albedo<const C: usize>(&self, p: V3, word: u32) -> [f32; C] {
        match &self.field {
            None => std::array::from_fn(|c| self.constant[c]),
            Some(field) => [field.one_read(p, word); C],
        }
    }

    /// The albedo at a point.
    pub fn albedo_at(&self, p: V3) -> [f64; 3] {
        match &self.field {
            None => self.constant.map(f64::from),
            Some(field) => [f64::from(field.at(p)); 3],
        }
    }

    /// Absorption at a point of the given density, in multiples of [`Plan::largest_absorption`].
    #[inline(always)]
    pub fn relative_absorption(&self, p: V3, density: f32) -> f32 {
        let relative = density * self.per_density;
        match &self.field {
            None => relative,
            Some(field) => relative * (1.0 - field.at(p)),
        }
    }
}

/// The eye in voxel coordinates.
#[derive(Debug, Clone, Copy)]
pub enum LocalEye {
    /// A point.
    Point(V3),
    /// A direction towards it.
    Direction(V3),
}

impl LocalEye {
    /// The eye of a camera.
    pub fn new(scene: &Scene, camera: &Camera) -> Self {
        let volume = &scene.medium.volume;
        match camera.eye() {
            Eye::Point(world) => {
                let (p, h) = (volume.local(world), volume.spacing());
                LocalEye::Point(std::array::from_fn(|a| (p[a] / h[a]) as f32))
            }
            Eye::Direction(d) => LocalEye::Direction(d.map(|c| c as f32)),
        }
    }

    /// The unit vector from a point towards the eye.
    #[inline(always)]
    pub fn from(&self, p: V3, h: V3) -> V3 {
        match self {
            LocalEye::Direction(d) => *d,
            LocalEye::Point(eye) => {
                let r: V3 = std::array::from_fn(|a| (eye[a] - p[a]) * h[a]);
                let norm = (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]).sqrt().max(1e-30);
                r.map(|c| c / norm)
            }
        }
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

    #[test]
    fn energies_that_leave_their_range_are_an_error() {
        let near = |units: i64| Energies::from_units([[units; 3]; Share::COUNT], 0);
        let mut fits = near(i64::MAX - (1 << 37));
        fits.add(Share::Absorbed, [1.0f32], 0.5);
        assert!(fits.checked().is_ok());
        fits.add(Share::Absorbed, [2.0f32], 0.5);
        assert!(fits.checked().is_err_and(|e| e.to_string().contains("2^63")));
        assert!(near(1 << 62).merge(near(1 << 62)).checked().is_err());
        assert!(near(1 << 61).merge(near(1 << 61)).checked().is_ok());
        assert!(near(-1 << 62).merge(near(-1 << 62)).merge(near(-1)).checked().is_err());
        // What is not finite is no energy.
        let mut infinite = near(1);
        infinite.add(Share::Absorbed, [f32::INFINITY], 0.5);
        assert!(infinite.checked().is_err());
    }

    #[test]
    fn small_energies_keep_their_mean() {
        let mut sum = Energies::default();
        let n = 1 << 20;
        for i in 0..n {
            let xi = rounding(crate::physics::rng::words([1, 0], [i, 0], 0, 0)[0]);
            // A hundredth of a unit, up and down.
            sum.add(Share::Absorbed, [0.01 / ENERGY_UNIT, -0.01 / ENERGY_UNIT], xi);
        }
        for (channel, sign) in [(0, 1.0), (1, -1.0)] {
            let units = sum.get(Share::Absorbed, channel) * f64::from(ENERGY_UNIT) * sign;
            let (mean, error) = (0.01 * f64::from(n), (0.01 * f64::from(n)).sqrt());
            // 1 in 10^7.
            assert!((units - mean).abs() < 5.3 * error, "{units} of {mean}");
        }
    }
}
