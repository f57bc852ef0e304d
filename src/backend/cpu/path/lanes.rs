//! Paths in lanes: the flights of [`crate::backend::cpu::flights`], and connections to the lights that wait in a queue until
//! they fill all lanes.

use super::connect::{Connections, Lit};
use super::primary::{First, Profile};
use super::walk::PATH;
use super::{Job, Seen, Tracer};
use crate::backend::cpu::course::{Course, Scored};
use crate::backend::cpu::flights::{ALL, Flights, N, Row, bits, mask};
use crate::backend::cpu::light::{Incident, Source};
use crate::backend::cpu::shoot::{ROULETTE, SURVIVAL};
use crate::backend::cpu::simd::{Kernel, best, dispatch};
use crate::physics::Real;
use crate::physics::rng::{split, uniform, words};
use crate::plan::{Plan, Simd};
use crate::scene::field::V3;

/// Events between looks at the clock and the stop flag.
const PATIENCE: u32 = 1 << 12;
/// The purposes of the random numbers of near lights begin here.
const NEAR: u32 = 1 << 16;
/// Those of maps.
const MAPS: u32 = 1 << 24;

/// Walks paths in lanes, with `C` channels of equal extinction.
pub struct Laned<'a, const C: usize> {
    simd: Simd,
    course: Course<'a>,
    connections: &'a Connections<'a>,
    last: u32,
}

impl<'a, const C: usize> Laned<'a, C> {
    /// From a plan.
    pub fn new(plan: &'a Plan<'a>, connections: &'a Connections<'a>) -> Self {
        Laned {
            simd: plan.settings.simd.unwrap_or_else(best),
            course: Course::new(plan, Scored::Nowhere, PATH),
            connections,
            last: plan.orders,
        }
    }
}

impl<const C: usize> Tracer<C> for Laned<'_, C> {
    fn trace(&self, job: &Job, seen: &mut [Seen<C>], halted: &(impl Fn() -> bool + Sync)) -> u64 {
        dispatch(self.simd, Run { tables: self, job, seen, halted })
    }
}

/// The paths of one job.
struct Run<'r, 'a, F, const C: usize> {
    tables: &'r Laned<'a, C>,
    job: &'r Job<'r>,
    seen: &'r mut [Seen<C>],
    halted: &'r F,
}

impl<F: Fn() -> bool + Sync, const C: usize> Kernel for Run<'_, '_, F, C> {
    type Output = u64;

    #[inline(always)]
    fn run(self) -> u64 {
        let Run { tables, job, seen, halted } = self;
        let course = &tables.course;
        let mut lanes = Lanes::<C>::new(tables);
        let mut seeds = Seeds::<C>::new();
        let mut queue = Queue::<C>::new();
        let (mut dead, mut hit) = (ALL, 0u32);
        let mut flying = 0u32;
        let mut since = 0u32;
        let mut collisions = 0u64;
        loop {
            while dead != 0 && seeds.ready(tables, job, seen) {
                let lane = dead.trailing_zeros() as usize;
                dead &= dead - 1;
                hit |= u32::from(job.walked) << lane;
                lanes.sow(lane, &mut seeds);
            }
            let mut alive = ALL & !dead;
            if alive == 0 {
                break;
            }
            since += 1;
            if since.is_multiple_of(PATIENCE) && halted() {
                return collisions;
            }
            if hit != 0 {
                collisions += u64::from(hit.count_ones());
                alive &= !lanes.collide(tables, hit, &mut queue, seen);
                lanes.turn(tables, hit);
            }
            let inside = lanes.flights.advance(course, alive, &mut flying);
            if tables.connections.has_background() {
                for lane in bits(alive & !inside & !flying) {
                    // The background seen through the medium is no part of the image.
                    if lanes.order[lane] > 0 {
                        let d = std::array::from_fn(|a| lanes.flights.d[a][lane]);
                        lanes.see(lane, lanes.order[lane], tables.connections.met(d, lanes.chance[lane]), seen);
                    }
                }
            }
            dead = ALL & !inside & !flying;
            hit = if course.certain {
                lanes.flights.accept_all();
                inside
            } else {
                let dense = course.voids.as_ref().map_or(inside, |voids| lanes.flights.dense(voids) & inside);
                lanes.flights.accept(course, dense)
            };
        }
        queue.flush(tables, seen, 0);
        collisions
    }
}

/// The paths that are under way.
#[repr(C, align(64))]
struct Lanes<const C: usize> {
    flights: Flights,
    weight: [Row<f32>; C],
    /// Scatterings so far.
    order: Row<u32>,
    /// The view ray of the job.
    slot: Row<u32>,
    /// The density of the direction in which it was scattered last, where that matters.
    chance: Row<f32>,
}

impl<const C: usize> Lanes<C> {
    fn new(tables: &Laned<C>) -> Self {
        let flights = Flights::new(&tables.course);
        Lanes { flights, weight: [[0.0; N]; C], order: [0; N], slot: [0; N], chance: [1.0; N] }
    }

    /// Puts the next path into a lane, at its first collision.
    #[inline(always)]
    fn sow(&mut self, lane: usize, seeds: &mut Seeds<C>) {
        seeds.left -= 1;
        let seed = seeds.left;
        for a in 0..3 {
            self.flights.p[a][lane] = seeds.p[a][seed];
            self.flights.d[a][lane] = seeds.d[a];
        }
        for c in 0..C {
            self.weight[c][lane] = seeds.weight[c];
        }
        for k in 0..4 {
            self.flights.word[k][lane] = seeds.word[k][seed];
        }
        self.flights.xi[lane] = uniform(seeds.word[2][seed]);
        for k in 0..2 {
            self.flights.index[k][lane] = seeds.index[k][seed];
        }
        self.flights.block[lane] = seeds.block;
        self.order[lane] = 0;
        self.slot[lane] = seeds.slot;
    }

    /// Absorbs in the lanes of `hit`, and connects them to the lights; gives those that end here.
    #[inline(always)]
    fn collide(&mut self, tables: &Laned<C>, hit: u32, queue: &mut Queue<C>, seen: &mut [Seen<C>]) -> u32 {
        let (last, connections) = (tables.last, tables.connections);
        let albedo: [Row<f32>; C] = self.flights.albedos(&tables.course, hit);
        let (mut dark, mut faint) = ([false; N], [false; N]);
        for i in 0..N {
            let hit = hit >> i & 1 == 1;
            let mut top = 0.0f32;
            for c in 0..C {
                let weight = self.weight[c][i] * if hit { albedo[c][i] } else { 1.0 };
                self.weight[c][i] = weight;
                top = Real::max(top, weight);
            }
            dark[i] = hit && (top <= 0.0 || self.order[i] >= last);
            faint[i] = hit && top < ROULETTE;
            self.order[i] += u32::from(hit);
        }
        let mut ended = mask(|i| dark[i]);
        if !connections.far.is_empty() {
            for lane in bits(hit & !ended) {
                queue.push(self, lane);
            }
            if queue.len >= N {
                queue.flush(tables, seen, queue.len - N);
            }
        }
        if last == u32::MAX {
            for lane in bits(mask(|i| faint[i]) & !ended) {
                if self.flights.survives(lane) {
                    for c in 0..C {
                        self.weight[c][lane] *= 1.0 / SURVIVAL;
                    }
                } else {
                    ended |= 1 << lane;
                }
            }
        }
        for lane in bits(if connections.maps.is_empty() { 0 } else { hit & !ended }) {
            self.under_maps(tables, lane, seen);
        }
        if !connections.near.is_empty() {
            for lane in bits(hit & !ended) {
                if self.order[lane] < last {
                    self.once_more(tables, lane, seen);
                }
            }
        }
        if !connections.has_background() {
            ended |= hit & mask(|i| self.order[i] >= last);
        }
        ended
    }

    /// Scatters some lanes into a new direction.
    #[inline(always)]
    fn turn(&mut self, tables: &Laned<C>, hit: u32) {
        if tables.connections.maps.is_empty() {
            return self.flights.turn(&tables.course, hit);
        }
        let before = self.flights.d;
        self.flights.turn(&tables.course, hit);
        let after = &self.flights.d;
        let mut cos_theta = [0.0f32; N];
        for i in 0..N {
            let cosine = before[0][i] * after[0][i] + before[1][i] * after[1][i] + before[2][i] * after[2][i];
            cos_theta[i] = Real::max(Real::min(cosine, 1.0), -1.0);
        }
        let chance = tables.course.phase.pdf_lanes(&cos_theta);
        for i in 0..N {
            self.chance[i] = if hit >> i & 1 == 1 { chance[i] } else { self.chance[i] };
        }
    }

    /// Where the path of a lane collided, along which direction it came, and random words for the given purpose.
    #[inline(always)]
    fn vertex(&self, tables: &Laned<C>, lane: usize, purpose: u32) -> (V3, V3, [u32; 4]) {
        let flights = &self.flights;
        let [p, d]: [V3; 2] = [&flights.p, &flights.d].map(|rows| std::array::from_fn(|a| rows[a][lane]));
        let index = [flights.index[0][lane], flights.index[1][lane]];
        (p, d, words(tables.course.seed, index, flights.block[lane], purpose))
    }

    /// Adds light that a lane's path sees, for a weight of 1.
    #[inline(always)]
    fn see(&self, lane: usize, order: u32, light: [f32; 3], seen: &mut [Seen<C>]) {
        seen[self.slot[lane] as usize].add(order, std::array::from_fn(|c| self.weight[c][lane] * light[c]));
    }

    /// Adds the light of maps that is scattered at the collision of a lane, from directions drawn from the maps.
    #[inline(always)]
    fn under_maps(&self, tables: &Laned<C>, lane: usize, seen: &mut [Seen<C>]) {
        for (purpose, map) in (MAPS..).zip(&tables.connections.maps) {
            let (p, d, words) = self.vertex(tables, lane, purpose);
            self.see(lane, self.order[lane], tables.connections.under_map(map, p, d, words), seen);
        }
    }

    /// Adds the light of near lights that is scattered once more beyond the collision of a lane.
    #[inline(always)]
    fn once_more(&self, tables: &Laned<C>, lane: usize, seen: &mut [Seen<C>]) {
        for (purpose, light) in (NEAR..).zip(&tables.connections.near) {
            let (p, d, words) = self.vertex(tables, lane, purpose);
            let further = |y: V3, word: u32| tables.course.medium.albedo(y, word);
            self.see(lane, self.order[lane] + 1, tables.connections.once_more(light, p, d, words, further), seen);
        }
    }
}

/// Paths of one view ray that wait for a lane.
struct Seeds<const C: usize> {
    profile: Profile,
    p: [Row<f32>; 3],
    d: V3,
    weight: [f32; C],
    word: [Row<u32>; 4],
    index: [Row<u32>; 2],
    /// Blocks of random words used.
    block: u32,
    slot: u32,
    /// How many wait: the first ones of the rows.
    left: usize,
    /// The next view ray.
    next: usize,
}

impl<const C: usize> Seeds<C> {
    fn new() -> Self {
        Seeds {
            profile: Profile::default(),
            p: [[0.0; N]; 3],
            d: [0.0; 3],
            weight: [0.0; C],
            word: [[0; N]; 4],
            index: [[0; N]; 2],
            block: 0,
            slot: 0,
            left: 0,
            next: 0,
        }
    }

    /// Whether a path waits, after those of the next view ray were started if need be.
    #[inline(always)]
    fn ready(&mut self, tables: &Laned<C>, job: &Job, seen: &mut [Seen<C>]) -> bool {
        while self.left == 0 && self.next < seen.len() {
            let at = self.next;
            self.next += 1;
            let Some(mut first) = First::new(job, tables.connections, &mut self.profile, at) else { continue };
            let mut from = 0;
            seen[at].share = first.share;
            self.d = first.ray.direction;
            self.slot = at as u32;
            self.weight = [1.0; C];
            self.block = u32::from(job.walked);
            for k in 0..job.starts {
                let i = k as usize;
                let index = split(job.sample(at).1 * job.starts + k);
                (self.index[0][i], self.index[1][i]) = (index[0], index[1]);
                let mut p = first.ray.p;
                if job.walked {
                    let start = first.start::<C>(k, &mut from);
                    first.near_lights(tables.connections, &tables.course.medium, &start, &mut seen[at]);
                    self.weight = start.weights.get();
                    p = start.spot.p;
                    let four = words(tables.course.seed, index, 0, PATH);
                    for k in 0..4 {
                        self.word[k][i] = four[k];
                    }
                }
                for a in 0..3 {
                    self.p[a][i] = p[a];
                }
            }
            self.left = job.starts as usize;
        }
        self.left > 0
    }
}

/// Collisions that wait to be connected to the lights.
struct Queue<const C: usize> {
    p: [[f32; 2 * N]; 3],
    d: [[f32; 2 * N]; 3],
    weight: [[f32; 2 * N]; C],
    order: [u32; 2 * N],
    slot: [u32; 2 * N],
    /// Random bits that decide on a correction.
    word: [u32; 2 * N],
    len: usize,
}

impl<const C: usize> Queue<C> {
    fn new() -> Self {
        Queue {
            p: [[0.5; 2 * N]; 3],
            d: [[0.0; 2 * N]; 3],
            weight: [[0.0; 2 * N]; C],
            order: [0; 2 * N],
            slot: [0; 2 * N],
            word: [0; 2 * N],
            len: 0,
        }
    }

    /// Lets the collision of a lane wait.
    #[inline(always)]
    fn push(&mut self, lanes: &Lanes<C>, lane: usize) {
        let at = self.len;
        for a in 0..3 {
            self.p[a][at] = lanes.flights.p[a][lane];
            self.d[a][at] = lanes.flights.d[a][lane];
        }
        for c in 0..C {
            self.weight[c][at] = lanes.weight[c][lane];
        }
        self.order[at] = lanes.order[lane];
        self.slot[at] = lanes.slot[lane];
        self.word[at] = lanes.flights.word[3][lane];
        self.len += 1;
    }

    /// Connects those from `from` on, N at most.
    #[inline(always)]
    fn flush(&mut self, tables: &Laned<C>, seen: &mut [Seen<C>], from: usize) {
        let count = self.len - from;
        let [p, d]: [[Row<f32>; 3]; 2] = [&self.p, &self.d].map(|rows| {
            std::array::from_fn(|a| {
                let mut row = [0.5f32; N];
                row[..count].copy_from_slice(&rows[a][from..from + count]);
                row
            })
        });
        let mut sum = [[0.0f32; N]; C];
        for light in &tables.connections.far {
            let rows = arrive(tables, light, &p, &d, &self.word[from..from + count]);
            for c in 0..C {
                for i in 0..N {
                    sum[c][i] += rows[c][i];
                }
            }
        }
        for i in 0..count {
            let at = from + i;
            let light = std::array::from_fn(|c| self.weight[c][at] * sum[c][i]);
            seen[self.slot[at] as usize].add(self.order[at], light);
        }
        self.len = from;
    }
}

/// [`Connections::scattered`] in lanes, for one light.
#[inline(always)]
fn arrive<const C: usize>(
    tables: &Laned<C>,
    light: &Lit,
    p: &[Row<f32>; 3],
    d: &[Row<f32>; 3],
    word: &[u32],
) -> [Row<f32>; C] {
    let (view, course) = (&light.view, &tables.course);
    let h = course.medium.h;
    let mut l = [[0.0f32; N]; 3];
    let (mut falloff, mut distance) = ([1.0f32; N], [f32::INFINITY; N]);
    match view.source {
        Source::Directional(direction) => {
            for a in 0..3 {
                l[a] = [direction[a]; N];
            }
        }
        Source::Point(position) => {
            for i in 0..N {
                let mut r = [0.0f32; 3];
                for a in 0..3 {
                    r[a] = (p[a][i] - position[a]) * h[a];
                }
                let d2 = Real::max(r[0] * r[0] + r[1] * r[1] + r[2] * r[2], 1e-30);
                falloff[i] = 1.0 / d2;
                distance[i] = d2.sqrt();
                for a in 0..3 {
                    l[a][i] = r[a] / distance[i];
                }
            }
        }
    }
    let mut cos_theta = [0.0f32; N];
    for i in 0..N {
        let cosine = -(l[0][i] * d[0][i] + l[1][i] * d[1][i] + l[2][i] * d[2][i]);
        cos_theta[i] = Real::max(Real::min(cosine, 1.0), -1.0);
    }
    let phase = course.phase.pdf_lanes(&cos_theta);
    let mut column = [0.0f32; N];
    let point = |i: usize| -> V3 { std::array::from_fn(|a| p[a][i]) };
    let incident =
        |i: usize| Incident { direction: std::array::from_fn(|a| l[a][i]), falloff: falloff[i], distance: distance[i] };
    if let Some(density) = course.field.constant().filter(|_| !course.field.is_ball()) {
        let n = course.field.n();
        for i in 0..N {
            let mut way = distance[i];
            for a in 0..3 {
                // Against the light, up to the face.
                let edge = if l[a][i] > 0.0 { p[a][i] } else { p[a][i] - n[a] as f32 };
                let t = edge * h[a] / l[a][i];
                way = if l[a][i] == 0.0 { way } else { Real::min(way, t) };
            }
            column[i] = density * way;
        }
    } else {
        for i in 0..word.len() {
            column[i] = view.column(point(i), &incident(i));
        }
    }
    let extinction = tables.connections.extinction[0];
    let mut through = [0.0f32; N];
    for i in 0..N {
        through[i] = Real::exp(-extinction * column[i]);
    }
    if light.check < 1.0 {
        let below = (light.check * 1024.0) as u32;
        for (i, word) in word.iter().enumerate() {
            if word & 1023 < below {
                let exact = Real::exp(-extinction * view.ray(point(i), &incident(i)));
                through[i] += (exact - through[i]) / (below as f32 * (1.0 / 1024.0));
            }
        }
    }
    let mut out = [[0.0f32; N]; C];
    for c in 0..C {
        for i in 0..N {
            out[c][i] = view.value[c] * phase[i] * falloff[i] * through[i];
        }
    }
    out
}
