//! The photon walk in lanes: the flights of [`super::flights`], with weights, scores and energies. Adds to the tallies are
//! loops of their own. A photon that ends hands its lane to the next at once.
//!
//! Flights score weight / majorant at every tentative collision. Majorants are high enough for that to happen in every
//! voxel that a photon crosses often enough to have a normal spread: where the medium is thinner, they are raised.

use super::course::{Course, Scored};
use super::emit::{Cursor, FirstCollisions, Start};
use super::energies::Energies;
use super::flights::{ALL, Flights, N, Row, bits, mask};
use super::shoot::{Engine, ROULETTE, SURVIVAL, Task, Walk};
use super::simd::{Kernel, best, dispatch};
use crate::physics::Real;
use crate::physics::harmonics::{MAX_ORDER, count, evaluate};
use crate::physics::rng::{rounding, split, uniform, uniform64, words};
use crate::plan::{Plan, Route, Simd};
use crate::result::{EXIT_FACES, Share};
use crate::scene::field::{V3, leave};
use crate::tally::Bins;

/// Events between looks at the clock and the stop flag.
const PATIENCE: u32 = 1 << 12;

/// Walks the photons of a plan in lanes, with `C` channels of equal extinction.
pub struct Laned<'a, const C: usize> {
    simd: Simd,
    course: Course<'a>,
    /// Whether what lies in voids is scored.
    scores_voids: bool,
    last: u32,
    /// Order of the spherical harmonics, if the directions of flight are recorded in these.
    harmonics: Option<usize>,
    routes: [Route; 3],
    /// The layer of absorption.
    absorbed: Option<usize>,
}

impl<'a, const C: usize> Laned<'a, C> {
    /// From a plan.
    pub fn new(plan: &'a Plan<'a>) -> Self {
        let voxels = plan.settings.fluence || plan.settings.radiance;
        Laned {
            simd: plan.settings.simd.unwrap_or_else(best),
            course: Course::new(plan, if voxels { Scored::Everywhere } else { Scored::ForImages }, 0),
            scores_voids: voxels,
            last: plan.walked_orders(),
            harmonics: plan.harmonics,
            routes: plan.routes,
            absorbed: plan.absorbed,
        }
    }
}

impl<const C: usize> Engine for Laned<'_, C> {
    const TASK: u64 = 8192;

    fn task(&self, walk: &Walk, task: &Task, energies: &mut Energies, halted: &(impl Fn() -> bool + Sync)) {
        dispatch(self.simd, Run { tables: self, walk, task, energies, halted });
    }
}

/// The walk of one task.
struct Run<'r, 'a, F, const C: usize> {
    tables: &'r Laned<'a, C>,
    walk: &'r Walk<'r>,
    task: &'r Task<'r>,
    energies: &'r mut Energies,
    halted: &'r F,
}

/// The photons that are under way.
#[repr(C, align(64))]
struct Lanes<const C: usize> {
    flights: Flights,
    weight: [Row<f32>; C],
    /// What was absorbed of it so far.
    absorbed: [Row<f32>; C],
    /// Scatterings so far.
    order: Row<u32>,
    /// What a tentative collision leaves in its voxel.
    score: [Row<f32>; C],
    /// The highest order.
    last: u32,
}

impl<F: Fn() -> bool + Sync, const C: usize> Kernel for Run<'_, '_, F, C> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Run { tables, walk, task, energies, halted } = self;
        let mut lanes = Lanes::<C>::new(tables);
        let sinks = Sinks::new(tables, walk, task);
        let mut seeds = Seeds::<C>::new(task);
        // Lanes that need a photon, and those that hold one at a real collision, as bits.
        let (mut dead, mut hit) = (ALL, 0u32);
        // Those that are between two cells of the majorant grid.
        let mut flying = 0u32;
        let mut since = 0u32;
        loop {
            while dead != 0 && seeds.ready(tables, task, energies) {
                let lane = dead.trailing_zeros() as usize;
                dead &= dead - 1;
                hit |= u32::from(seeds.at_collision) << lane;
                lanes.sow(lane, &mut seeds);
            }
            let mut alive = ALL & !dead;
            if alive == 0 {
                return;
            }
            since += 1;
            if since.is_multiple_of(PATIENCE) && halted() {
                return;
            }
            if hit != 0 {
                energies.collisions += u64::from(hit.count_ones());
                let ends = lanes.collide(tables, hit);
                for lane in bits(ends) {
                    if lanes.decide(lane, tables, energies) {
                        alive &= !(1 << lane);
                    }
                }
            }
            let inside = lanes.flights.advance(&tables.course, alive, &mut flying);
            for lane in bits(alive & !inside & !flying) {
                lanes.escape(lane, tables, energies);
            }
            dead = ALL & !inside & !flying;
            lanes.flights.locate(&tables.course);
            let dense = match &tables.course.voids {
                Some(voids) => lanes.flights.dense(voids) & inside,
                None => inside,
            };
            lanes.deposit(tables, walk, &sinks, if tables.scores_voids { inside } else { dense });
            hit = if tables.course.certain {
                lanes.flights.accept_all();
                inside
            } else {
                lanes.flights.accept(&tables.course, dense)
            };
            if tables.absorbed.is_some() {
                lanes.absorb(tables, &sinks, dense);
            }
        }
    }
}

/// Photons that have started and wait for a lane.
struct Seeds<const C: usize> {
    p: [Row<f32>; 3],
    d: [Row<f32>; 3],
    weight: [Row<f32>; C],
    /// Random words of the collision that they start at, if they do.
    word: [Row<u32>; 4],
    index: [Row<u32>; 2],
    block: Row<u32>,
    at_collision: bool,
    /// How many wait: the first ones of the rows.
    left: usize,
    /// The emitter's next photon.
    next: u64,
    cursor: Cursor,
}

impl<const C: usize> Seeds<C> {
    fn new(task: &Task) -> Self {
        Seeds {
            p: [[0.0; N]; 3],
            d: [[0.0; N]; 3],
            weight: [[0.0; N]; C],
            word: [[0; N]; 4],
            index: [[0; N]; 2],
            block: [0; N],
            at_collision: task.emitter.first_collisions().is_some(),
            left: 0,
            next: task.range.start,
            cursor: Cursor::default(),
        }
    }

    /// Whether a photon waits, after more were started if need be.
    #[inline(always)]
    fn ready(&mut self, tables: &Laned<C>, task: &Task, energies: &mut Energies) -> bool {
        while self.left == 0 && self.next < task.range.end {
            match task.emitter.first_collisions() {
                Some(first) => self.collide(first, tables, task),
                None => self.enter(tables, task, energies),
            }
        }
        self.left > 0
    }

    /// Starts up to `N` photons at their first collisions.
    #[inline(always)]
    fn collide(&mut self, first: &FirstCollisions, tables: &Laned<C>, task: &Task) {
        let count = (task.range.end - self.next).min(N as u64) as usize;
        let mut place = [[0; N]; 4];
        for i in 0..N {
            [self.index[0][i], self.index[1][i]] = split(task.first + self.next + i as u64);
        }
        for i in 0..N {
            let index = [self.index[0][i], self.index[1][i]];
            let (one, two) = (words(tables.course.seed, index, 0, 0), words(tables.course.seed, index, 1, 0));
            for k in 0..4 {
                place[k][i] = one[k];
                self.word[k][i] = two[k];
            }
        }
        self.block = [2; N];
        for i in 0..count {
            let u = ((self.next + i as u64) as f64 + uniform64(place[0][i])) / task.count as f64;
            let (voxel, share) = first.find(&mut self.cursor, u);
            let p: V3 = std::array::from_fn(|a| voxel[a] as f32 + uniform(place[1 + a][i]));
            let (d, weight) = first.arrive(p, share);
            for a in 0..3 {
                self.p[a][i] = p[a];
                self.d[a][i] = d[a];
            }
            for c in 0..C {
                self.weight[c][i] = weight[c] * task.scale[c];
            }
        }
        self.next += count as u64;
        self.left = count;
    }

    /// Starts the next photon at its light.
    #[inline(always)]
    fn enter(&mut self, tables: &Laned<C>, task: &Task, energies: &mut Energies) {
        let index = split(task.first + self.next);
        let weight: [f32; C] = std::array::from_fn(|c| task.scale[c]);
        let (mut draws, start) = task.start(tables.course.seed, self.next);
        self.next += 1;
        let (p, direction, weight) = match start {
            Start::Flight { p, direction } => (p, direction, weight),
            Start::Coloured { p, direction, weight } => {
                (p, direction, std::array::from_fn(|c| weight[c] * task.scale[c]))
            }
            Start::Miss | Start::Collision { .. } => {
                return energies.add(Share::Missed, weight, rounding(draws.next4()[3]));
            }
        };
        for a in 0..3 {
            self.p[a][0] = p[a];
            self.d[a][0] = direction[a];
        }
        for c in 0..C {
            self.weight[c][0] = weight[c];
        }
        (self.index[0][0], self.index[1][0]) = (index[0], index[1]);
        self.block[0] = draws.block();
        self.left = 1;
    }
}

/// The bins that scores of incident order 0, of the inner orders, and of the last go to.
struct Sinks<'w> {
    plain: [Option<&'w Bins>; 3],
    angular: [Option<&'w Bins>; 3],
    absorbed: [Option<&'w Bins>; 3],
}

impl<'w> Sinks<'w> {
    fn new<const C: usize>(tables: &Laned<C>, walk: &'w Walk, task: &Task) -> Self {
        let first = if task.emitter.tallies_unscattered { tables.routes[0] } else { (None, None) };
        let routes = [first, tables.routes[1], tables.routes[2]];
        let set = walk.set();
        let bins = |layer: Option<usize>| layer.map(|l| &walk.bins[l][set]);
        Sinks {
            plain: routes.map(|r| bins(r.0)),
            angular: routes.map(|r| bins(r.1)),
            absorbed: routes.map(|r| bins(r.0.and(tables.absorbed))),
        }
    }
}

impl<const C: usize> Lanes<C> {
    fn new(tables: &Laned<C>) -> Self {
        Lanes {
            last: tables.last,
            flights: Flights::new(&tables.course),
            weight: [[0.0; N]; C],
            absorbed: [[0.0; N]; C],
            order: [0; N],
            score: [[0.0; N]; C],
        }
    }

    /// Puts the next photon into a lane.
    #[inline(always)]
    fn sow(&mut self, lane: usize, seeds: &mut Seeds<C>) {
        seeds.left -= 1;
        let seed = seeds.left;
        for a in 0..3 {
            self.flights.p[a][lane] = seeds.p[a][seed];
            self.flights.d[a][lane] = seeds.d[a][seed];
        }
        for c in 0..C {
            self.weight[c][lane] = seeds.weight[c][seed];
            self.absorbed[c][lane] = 0.0;
        }
        for k in 0..4 {
            self.flights.word[k][lane] = seeds.word[k][seed];
        }
        self.flights.xi[lane] = uniform(seeds.word[2][seed]);
        for k in 0..2 {
            self.flights.index[k][lane] = seeds.index[k][seed];
        }
        self.flights.block[lane] = seeds.block[seed];
        self.order[lane] = 0;
    }

    /// Absorbs and scatters in the lanes of `hit`; gives those whose fate must be decided.
    #[inline(always)]
    fn collide(&mut self, tables: &Laned<C>, hit: u32) -> u32 {
        let last = tables.last;
        let unlimited = last == u32::MAX;
        let albedo: [Row<f32>; C] = self.flights.albedos(&tables.course, hit);
        let mut ends = [false; N];
        for i in 0..N {
            let hit = hit >> i & 1 == 1;
            let mut top = 0.0f32;
            for c in 0..C {
                let before = self.weight[c][i];
                let after = if hit { before * albedo[c][i] } else { before };
                self.absorbed[c][i] += before - after;
                self.weight[c][i] = after;
                top = Real::max(top, after);
            }
            let order = self.order[i];
            ends[i] = hit && (top <= 0.0 || order >= last || (unlimited && top < ROULETTE));
            self.order[i] = order + u32::from(hit);
        }
        self.flights.turn(&tables.course, hit);
        mask(|i| ends[i])
    }

    /// Ends the photon of a lane, or plays roulette; true if it is dead.
    #[inline(always)]
    fn decide(&mut self, lane: usize, tables: &Laned<C>, energies: &mut Energies) -> bool {
        let after: [f32; C] = std::array::from_fn(|c| self.weight[c][lane]);
        let top = after.iter().fold(0.0, |m: f32, &x| m.max(x));
        let xi = rounding(self.flights.word[3][lane]);
        let dead = if top <= 0.0 {
            true
        } else if self.order[lane] > tables.last {
            energies.add(Share::Truncated, after, xi);
            true
        } else if !self.flights.survives(lane) {
            energies.add(Share::Roulette, after, xi);
            true
        } else {
            for c in 0..C {
                self.weight[c][lane] *= 1.0 / SURVIVAL;
            }
            energies.add::<C>(Share::Roulette, std::array::from_fn(|c| after[c] - self.weight[c][lane]), xi);
            false
        };
        if dead {
            energies.add::<C>(Share::Absorbed, std::array::from_fn(|c| self.absorbed[c][lane]), xi);
        }
        dead
    }

    /// Lets the photon of a lane out of the box.
    #[inline(always)]
    fn escape(&mut self, lane: usize, tables: &Laned<C>, energies: &mut Energies) {
        let p: V3 = std::array::from_fn(|a| self.flights.p[a][lane]);
        let v: V3 = std::array::from_fn(|a| self.flights.d[a][lane] * tables.course.medium.inverse_h[a]);
        let (axis, _) = leave(p, v, tables.course.field.n());
        let face = 2 * axis + usize::from(v[axis] > 0.0);
        let share = if self.order[lane] == 0 { Share::Unscattered } else { EXIT_FACES[face] };
        let xi = rounding(self.flights.word[3][lane]);
        energies.add::<C>(share, std::array::from_fn(|c| self.weight[c][lane]), xi);
        energies.add::<C>(Share::Absorbed, std::array::from_fn(|c| self.absorbed[c][lane]), xi);
    }

    /// Scores the tentative collisions of some lanes.
    #[inline(always)]
    fn deposit(&mut self, tables: &Laned<C>, walk: &Walk, sinks: &Sinks, scored: u32) {
        for c in 0..C {
            for i in 0..N {
                self.score[c][i] = self.weight[c][i] * (walk.units[c] * self.flights.free_path[i]);
            }
        }
        if let Some(order) = tables.harmonics {
            self.add_harmonics(order, &sinks.angular, scored);
        } else if sinks.angular.iter().any(Option::is_some) {
            let (Flights { q, d, .. }, eye) = (&self.flights, &tables.course.medium.eye);
            let mut cos_theta = [0.0; N];
            for i in 0..N {
                let to_eye = eye.from([q[0][i], q[1][i], q[2][i]], tables.course.medium.h);
                let cosine = to_eye[0] * d[0][i] + to_eye[1] * d[1][i] + to_eye[2] * d[2][i];
                cos_theta[i] = Real::max(Real::min(cosine, 1.0), -1.0);
            }
            let toward_eye = tables.course.phase.pdf_lanes(&cos_theta);
            let mut seen = self.score;
            for c in 0..C {
                for i in 0..N {
                    seen[c][i] *= toward_eye[i];
                }
            }
            self.add(&sinks.angular, &seen, scored);
        }
        if sinks.plain.iter().any(Option::is_some) {
            let score = self.score;
            self.add(&sinks.plain, &score, scored);
        }
    }

    /// Scores what is absorbed at the tentative collisions of some lanes, whose scores and densities have been found.
    #[inline(always)]
    fn absorb(&mut self, tables: &Laned<C>, sinks: &Sinks, dense: u32) {
        let relative = self.flights.absorption(&tables.course, dense);
        let mut absorbed = self.score;
        for c in 0..C {
            for i in 0..N {
                absorbed[c][i] *= relative[i];
            }
        }
        self.add(&sinks.absorbed, &absorbed, dense & mask(|i| relative[i] > 0.0));
    }

    /// Adds the spherical harmonics of the direction of flight to the bins of each lane's voxel, times its score.
    #[inline(always)]
    fn add_harmonics(&self, order: usize, sinks: &[Option<&Bins>; 3], scored: u32) {
        let k = count(order);
        let mut y = [0.0f32; count(MAX_ORDER)];
        for lane in bits(scored) {
            let Some(bins) = sinks[self.slot(lane)] else { continue };
            evaluate([0, 1, 2].map(|a| self.flights.d[a][lane]), order, &mut y[..k]);
            let xi = rounding(self.flights.word[3][lane]);
            let first = self.flights.voxel[lane] as usize * k * C;
            for (at, y) in y[..k].iter().enumerate() {
                for c in 0..C {
                    bins.add(first + at * C + c, self.score[c][lane] * y, xi);
                }
            }
        }
    }

    /// Which of the sinks a lane scores in.
    #[inline(always)]
    fn slot(&self, lane: usize) -> usize {
        let order = self.order[lane];
        if order == 0 { 0 } else { 1 + usize::from(order == self.last) }
    }

    /// Adds values to the bins of each lane's voxel.
    #[inline(always)]
    fn add(&mut self, sinks: &[Option<&Bins>; 3], value: &[Row<f32>; C], scored: u32) {
        // Nearly always all lanes are at an inner order.
        let outer = mask(|i| self.order[i] == 0 || self.order[i] == self.last) & scored;
        let mut xi = [0.0f32; N];
        for i in 0..N {
            xi[i] = rounding(self.flights.word[3][i]);
        }
        for c in 0..C {
            let mut whole = [0i32; N];
            let mut large = false;
            for i in 0..N {
                // As `tally::rounded` does, of what is not negative.
                let cut = value[c][i] as i32;
                whole[i] = cut + i32::from(xi[i] < value[c][i] - cut as f32);
                large |= value[c][i] >= 2_147_483_648.0;
            }
            if large {
                for lane in bits(scored) {
                    if let Some(bins) = sinks[self.slot(lane)] {
                        bins.add(self.flights.voxel[lane] as usize * C + c, value[c][lane], xi[lane]);
                    }
                }
                continue;
            }
            if let Some(bins) = sinks[1] {
                for lane in bits(scored & !outer) {
                    bins.add_word(self.flights.voxel[lane] as usize * C + c, whole[lane]);
                }
            }
            for lane in bits(outer) {
                if let Some(bins) = sinks[self.slot(lane)] {
                    bins.add_word(self.flights.voxel[lane] as usize * C + c, whole[lane]);
                }
            }
        }
    }
}
