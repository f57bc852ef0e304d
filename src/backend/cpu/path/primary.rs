//! View rays, and the first collisions on them: drawn evenly over what a ray meets, from one walk along it.

use super::connect::{Connections, Met, Spot};
use super::{Job, Seen};
use crate::backend::cpu::collision_medium::Medium;
use crate::backend::cpu::track::Weights;
use crate::physics::rng::{Draws, split, uniform, uniform64};
use crate::scene::ViewRay;
use crate::scene::field::{Field, along};

/// The purpose of the random numbers of view rays.
const VIEW: u32 = 8;

/// A piece of a line within which the density is one polynomial.
#[derive(Debug, Clone, Copy)]
struct Piece {
    cell: [i32; 3],
    t0: f32,
    t1: f32,
    /// Column density up to t1.
    column: f32,
}

/// The column density along a line, to be inverted at many points.
#[derive(Debug, Default)]
pub struct Profile {
    pieces: Vec<Piece>,
}

impl Profile {
    /// Walks along a ray, no further than where the column density exceeds `enough`, and gives what it met.
    pub fn walk(&mut self, field: &Field, ray: &ViewRay, enough: f32) -> f32 {
        self.pieces.clear();
        if let Some(density) = field.constant() {
            let column = density * ray.length;
            self.pieces.push(Piece { cell: [0; 3], t0: 0.0, t1: ray.length, column });
            return column;
        }
        let mut sum = 0.0f32;
        field.visit(ray.p, ray.v, ray.length, |cell, t0, t1| {
            let column = field.piece(cell, ray.p, ray.v, t0, t1);
            if column > 0.0 {
                sum += column;
                self.pieces.push(Piece { cell, t0, t1, column: sum });
            }
            sum <= enough
        });
        sum
    }

    /// Where the column density reaches `target`; `from` is a piece at or before it, and is moved there.
    pub fn invert(&self, field: &Field, ray: &ViewRay, target: f32, from: &mut usize) -> f32 {
        while *from + 1 < self.pieces.len() && self.pieces[*from].column <= target {
            *from += 1;
        }
        let Some(piece) = self.pieces.get(*from) else { return 0.0 };
        let before = if *from > 0 { self.pieces[*from - 1].column } else { 0.0 };
        let (rest, whole) = ((target - before).max(0.0), piece.column - before);
        if field.linear() && field.constant().is_none() {
            let corners = field.corners(piece.cell);
            return field.invert(&corners, piece.cell, ray.p, ray.v, (piece.t0, piece.t1), rest.min(whole));
        }
        (piece.t0 + (piece.t1 - piece.t0) * (rest / whole.max(1e-30)).min(1.0)).min(piece.t1)
    }
}

/// What the starts of a view ray's paths have in common.
pub struct First<'j> {
    /// The ray.
    pub ray: ViewRay,
    /// What a weight of 1 on one of its paths stands for.
    pub share: f32,
    /// What it meets.
    pub met: Met,
    /// The largest channel's opacity.
    top: f32,
    profile: &'j Profile,
    field: &'j Field<'j>,
    draws: Draws,
    starts: u64,
}

/// The start of a path, at its first collision.
#[derive(Debug, Clone, Copy)]
pub struct Start<const C: usize> {
    /// Where on the ray.
    pub spot: Spot,
    /// Its weights, before it scatters.
    pub weights: Weights<C>,
    /// A uniform number for a second point of the ray.
    pub xi: f32,
    /// A random word.
    pub word: u32,
}

impl<'j> First<'j> {
    /// The view ray number `at` of a job; `None` if it meets nothing.
    pub fn new(job: &'j Job, connections: &Connections, profile: &'j mut Profile, at: usize) -> Option<Self> {
        let plan = job.plan;
        let (pixel, sample) = job.sample(at);
        let camera = &plan.scene.camera;
        let [width, _] = camera.resolution;
        let inside = |axis: usize, x: usize| job.window[axis].0 <= x && x < job.window[axis].1;
        if !inside(0, pixel % width) || !inside(1, pixel / width) {
            return None;
        }
        let corner = [(pixel % width) as f64, (pixel / width) as f64];
        let mut draws = Draws::new(split(plan.settings.seed), sample, VIEW);
        let (place, weight) = place_in_pixel(job, corner, draws.next4());
        let ray = ViewRay::new(plan.scene, camera, corner[0] + place[0], corner[1] + place[1])?;
        if !job.walked {
            let met = Met { channels: 1, extinction: [0.0; 3], opacity: [1.0; 3] };
            let share = weight / job.starts as f32;
            return Some(First { ray, share, top: 1.0, met, profile, field: job.field, draws, starts: job.starts });
        }
        let column = profile.walk(job.field, &ray, job.enough);
        if column <= 0.0 || weight == 0.0 {
            return None;
        }
        let opacity = connections.extinction.map(|e| -(-e * column).exp_m1());
        let channels = if plan.chromatic { 3 } else { 1 };
        let met = Met { channels, extinction: connections.extinction, opacity };
        let top = opacity.iter().fold(0.0, |m: f32, &o| m.max(o));
        if top <= 0.0 {
            return None;
        }
        let share = weight * top / job.starts as f32;
        Some(First { ray, share, top, met, profile, field: job.field, draws, starts: job.starts })
    }

    /// Start number `k`, at the columns' k-th stratum; `from` is where the search for the one before ended.
    pub fn start<const C: usize>(&mut self, k: u64, from: &mut usize) -> Start<C> {
        let words = self.draws.next4();
        let hero = ((u64::from(words[1]) * self.met.channels as u64) >> 32) as usize;
        let part = (k as f64 + uniform64(words[0])) / self.starts as f64;
        let (extinction, opacity) = (self.met.extinction[hero], self.met.opacity[hero]);
        let target = -(-part * f64::from(opacity)).ln_1p() / f64::from(extinction.max(1e-30));
        // Heroes change from start to start: only that of a grey medium moves on.
        if self.met.channels > 1 {
            *from = 0;
        }
        let column = target as f32;
        let t = self.profile.invert(self.field, &self.ray, column, from);
        let n = self.field.n();
        let at = along(self.ray.p, self.ray.v, t);
        let p = std::array::from_fn(|a| at[a].clamp(0.0, n[a] as f32 * (1.0 - 6e-8)));
        let mut weights = Weights::new([1.0; C], 0);
        weights.hero = hero;
        if self.met.channels > 1 {
            weights.observe(std::array::from_fn(|c| self.met.chance(c, column)));
        }
        weights.value = std::array::from_fn(|c| self.met.opacity[c] / self.top);
        let xi = (k as f32 + uniform(words[2])) / self.starts as f32;
        Start { spot: Spot { p, t, column }, weights, xi, word: words[3] }
    }

    /// Adds what near lights send to the eye by being scattered once on this ray: at a first collision, and at a point drawn
    /// for each light.
    pub fn near_lights<const C: usize>(
        &self,
        connections: &Connections,
        medium: &Medium,
        start: &Start<C>,
        seen: &mut Seen<C>,
    ) {
        for light in &connections.near {
            let spots = [Some(start.spot), connections.spot(light, &self.ray, start.xi)];
            for spot in spots.into_iter().flatten() {
                let albedo: [f32; C] = medium.albedo(spot.p, start.word);
                let scattered = connections.on_view(light, &self.ray, spot, &self.met);
                seen.add(1, std::array::from_fn(|c| albedo[c] * scattered[c] / self.top));
            }
        }
    }
}

/// A point of a pixel, from its upper left corner, and its weight. Evenly drawn, but where a light in the medium is seen in
/// the pixel or beside it: there half of the rays are drawn by 1 / distance from its image, as their light is brightest.
fn place_in_pixel(job: &Job, corner: [f64; 2], words: [u32; 4]) -> ([f64; 2], f32) {
    let even = [uniform64(words[0]), uniform64(words[1])];
    let seen = |image: &&[f64; 2]| (0..2).all(|a| (image[a] - corner[a] - 0.5).abs() < 1.5);
    let Some(image) = job.images.iter().find(seen) else { return (even, 1.0) };
    let centre = [image[0] - corner[0], image[1] - corner[1]];
    let reach = (0..2).map(|a| centre[a].abs().max((1.0 - centre[a]).abs()).powi(2)).sum::<f64>().sqrt();
    let place = if words[2] & 1 == 0 {
        even
    } else {
        let (sin, cos) = (std::f64::consts::TAU * even[1]).sin_cos();
        [centre[0] + reach * even[0] * cos, centre[1] + reach * even[0] * sin]
    };
    if place.iter().any(|c| !(0.0..=1.0).contains(c)) {
        return (even, 0.0);
    }
    let off = (place[0] - centre[0]).hypot(place[1] - centre[1]).max(1e-12);
    let chance = 0.5 + 0.5 / (std::f64::consts::TAU * reach * off);
    (place, (1.0 / chance) as f32)
}
