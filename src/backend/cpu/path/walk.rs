//! Paths walked one by one: the truth that lanes are compared with, and what all trackers, chromatic extinction and
//! emission have.

use super::connect::Connections;
use super::primary::{First, Profile};
use super::{Job, Seen, Tracer};
use crate::backend::cpu::collision_medium::Medium;
use crate::backend::cpu::shoot::{ROULETTE, SURVIVAL};
use crate::backend::cpu::track::{Flight, Scorer, Tracker, Weights};
use crate::physics::frame::rotate;
use crate::physics::rng::{Draws, split, uniform};
use crate::scene::field::{Field, V3, along};

/// The purpose of the random numbers of paths.
pub const PATH: u32 = 9;
/// Collisions between looks at the clock and the stop flag within one path.
const PATIENCE: u32 = 1 << 14;

/// Flights of paths leave nothing behind.
struct Silent;

impl<const C: usize> Scorer<C> for Silent {
    #[inline(always)]
    fn score(&mut self, _: usize, _: V3, _: [f32; C], _: f32) {}

    #[inline(always)]
    fn absorbs(&self) -> bool {
        false
    }

    #[inline(always)]
    fn absorb(&mut self, _: usize, _: V3, _: f32, _: [f32; C], _: f32) {}
}

/// Paths walked one after the other by a tracker.
pub struct OneByOne<'a, T, const C: usize> {
    /// Samples flights.
    pub tracker: T,
    /// The lights.
    pub connections: &'a Connections<'a>,
    /// The medium at collisions.
    pub medium: Medium<'a>,
    /// The density.
    pub density: Field<'a>,
    /// What the medium emits, by channel.
    pub emission: Vec<Field<'a>>,
}

impl<const C: usize, T: Tracker<C>> Tracer<C> for OneByOne<'_, T, C> {
    fn trace(&self, job: &Job, seen: &mut [Seen<C>], halted: &(impl Fn() -> bool + Sync)) -> u64 {
        let mut collisions = 0;
        let mut profile = Profile::default();
        for (at, sum) in seen.iter_mut().enumerate() {
            if halted() {
                return collisions;
            }
            let Some(mut first) = First::new(job, self.connections, &mut profile, at) else { continue };
            sum.share = first.share;
            let mut from = 0;
            for k in 0..job.starts {
                let index = job.sample(at).1 * job.starts + k;
                let mut draws = Draws::new(split(job.plan.settings.seed), index, PATH);
                let (p, w) = if job.walked {
                    let start = first.start::<C>(k, &mut from);
                    first.near_lights(self.connections, &self.medium, &start, sum);
                    (start.spot.p, start.weights)
                } else {
                    let mut w = Weights::new([1.0; C], if job.plan.chromatic { draws.next4()[0] } else { 0 });
                    match self.tracker.fly(first.ray.p, first.ray.v, &mut w, &mut draws, &mut Silent) {
                        Flight::Exit(_) => continue,
                        Flight::Collision(p) => (p, w),
                    }
                };
                collisions += u64::from(self.path(job, (p, first.ray.direction), w, draws, sum, halted));
            }
        }
        collisions
    }
}

impl<const C: usize, T: Tracker<C>> OneByOne<'_, T, C> {
    /// Walks one path from its first collision to its end; gives the number of collisions.
    fn path(
        &self,
        job: &Job,
        (mut p, mut direction): (V3, V3),
        mut w: Weights<C>,
        mut draws: Draws,
        sum: &mut Seen<C>,
        halted: &impl Fn() -> bool,
    ) -> u32 {
        let plan = job.plan;
        let phase = &plan.scene.medium.phase;
        let (last, connections) = (plan.orders, self.connections);
        let mut order = 0u32;
        loop {
            let words = draws.next4();
            let albedo: [f32; C] = self.medium.albedo(p, words[2]);
            for c in 0..C {
                w.value[c] *= albedo[c];
            }
            let after = w.get();
            let top = after.iter().fold(0.0, |m: f32, &x| m.max(x));
            if top <= 0.0 || order >= last {
                return order + 1;
            }
            order += 1;
            if !connections.far.is_empty() {
                let scattered = connections.scattered(p, direction, &mut draws);
                sum.add(order, std::array::from_fn(|c| after[c] * scattered[c]));
            }
            if last == u32::MAX && top < ROULETTE {
                if uniform(words[3]) > SURVIVAL {
                    return order;
                }
                w.value = w.value.map(|x| x * (1.0 / SURVIVAL));
            }
            if order < last {
                let weight = w.get();
                for light in &connections.near {
                    let further = |y: V3, word: u32| self.medium.albedo(y, word);
                    let scattered = connections.once_more(light, p, direction, draws.next4(), further);
                    sum.add(order + 1, std::array::from_fn(|c| weight[c] * scattered[c]));
                }
            }
            let weight = w.get();
            for map in &connections.maps {
                let scattered = connections.under_map(map, p, direction, draws.next4());
                sum.add(order, std::array::from_fn(|c| weight[c] * scattered[c]));
            }
            if order == last && !connections.has_background() && self.emission.is_empty() {
                return order;
            }
            let (cos_theta, sin_theta) = phase.sample(uniform(words[0]));
            direction = rotate(direction, cos_theta, sin_theta, uniform(words[1]));
            let v = std::array::from_fn(|a| direction[a] * self.medium.inverse_h[a]);
            let before = w;
            let flight = self.tracker.fly(p, v, &mut w, &mut draws, &mut Silent);
            if !self.emission.is_empty() {
                let length = match flight {
                    Flight::Exit(_) => self.density.leave(p, v).1,
                    Flight::Collision(at) => {
                        (0..3).map(|a| ((at[a] - p[a]) * self.medium.h[a]).powi(2)).sum::<f32>().sqrt()
                    }
                };
                sum.add(order, self.emitted(before, p, v, length, &mut draws));
            }
            match flight {
                Flight::Exit(_) => {
                    let (weight, met) = (w.get(), connections.met(direction, phase.pdf(cos_theta)));
                    sum.add(order, std::array::from_fn(|c| weight[c] * met[c]));
                    return order;
                }
                Flight::Collision(at) => p = at,
            }
            if order.is_multiple_of(PATIENCE) && halted() {
                return order;
            }
        }
    }

    /// What the medium emits along a flight up to its end: its mean over flights is what arrives at their start. With unequal
    /// extinctions it is taken at a random point, for the weights change along the flight.
    fn emitted(&self, w: Weights<C>, p: V3, v: V3, length: f32, draws: &mut Draws) -> [f32; C] {
        let fields = &self.emission;
        let extinction = &self.connections.extinction;
        if extinction[0] == extinction[1] && extinction[1] == extinction[2] {
            let weight = w.get();
            let whole: [f32; 3] =
                std::array::from_fn(|c| fields.get(c).map_or(0.0, |field| field.column(p, v, length)));
            return std::array::from_fn(|c| weight[c] * whole[c % fields.len()]);
        }
        let t = length * uniform(draws.next4()[0]);
        let column = self.density.column(p, v, t);
        let mut here = w;
        let hero = extinction[w.hero];
        here.observe(std::array::from_fn(|c| ((hero - extinction[c]) * column).min(60.0).exp()));
        let (weight, at) = (here.get(), along(p, v, t));
        std::array::from_fn(|c| weight[c] * length * fields[c % fields.len()].at(at))
    }
}
