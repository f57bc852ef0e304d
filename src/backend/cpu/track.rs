//! Trackers: from one point of a photon's way to its next collision, or out of the box.

use crate::physics::flight::box_range;
use crate::physics::rng::{Draws, exponential, rounding, uniform};
use crate::plan::{LEAST_SCORED_DEPTH, MajorantGrid, Plan, Score};
use crate::scene::block_maxima;
use crate::scene::field::{Dda, Field, V3, along, local};

/// The weights of a photon in `C` channels. With unequal extinctions, one channel (the hero) decides the flight, and the
/// balance heuristic over the three that might have decided keeps every channel unbiased with bounded weights
/// (Miller, Georgiev, Jarosz, *A null-scattering path integral formulation of light transport*, SIGGRAPH 2019).
#[derive(Debug, Clone, Copy)]
pub struct Weights<const C: usize> {
    /// Weight without the flights: what albedo, emission and roulette made of it.
    pub value: [f32; C],
    /// Chance of the flights so far under each channel's extinction, over the mean of these chances.
    pub chance: [f32; C],
    /// The channel that decides.
    pub hero: usize,
}

impl<const C: usize> Weights<C> {
    /// A photon that has not flown yet; `word` chooses the hero.
    #[inline(always)]
    pub fn new(value: [f32; C], word: u32) -> Self {
        Weights { value, chance: [1.0; C], hero: ((u64::from(word) * C as u64) >> 32) as usize }
    }

    /// The unbiased weight in each channel.
    #[inline(always)]
    pub fn get(&self) -> [f32; C] {
        std::array::from_fn(|c| self.value[c] * self.chance[c])
    }

    /// Takes in an event of the given chance (any common scale) under each channel.
    #[inline(always)]
    pub fn observe(&mut self, chance: [f32; C]) {
        let mut sum = 0.0;
        for c in 0..C {
            self.chance[c] *= chance[c];
            sum += self.chance[c];
        }
        let scale = C as f32 / sum.max(1e-30);
        self.chance = self.chance.map(|x| x * scale);
    }
}

/// How a flight ends.
#[derive(Debug, Clone, Copy)]
pub enum Flight {
    /// At a point of the medium.
    Collision(V3),
    /// Through a face of the box.
    Exit(usize),
}

/// Where flights leave their scores: `weight * length` at a point of a voxel.
pub trait Scorer<const C: usize> {
    /// Adds to the voxel `index`, around the point `p`; `xi` within (0, 1] rounds.
    fn score(&mut self, index: usize, p: V3, value: [f32; C], xi: f32);

    /// Whether what is absorbed is scored too.
    fn absorbs(&self) -> bool;

    /// Adds what of the value is absorbed at a point `p` of the given density, drawn evenly from where the value is for.
    fn absorb(&mut self, index: usize, p: V3, density: f32, value: [f32; C], xi: f32);
}

/// Takes a photon to its next collision.
pub trait Tracker<const C: usize>: Sync {
    /// Flies from `p` along `v`, scoring on the way.
    fn fly<S: Scorer<C>>(&self, p: V3, v: V3, w: &mut Weights<C>, draws: &mut Draws, scorer: &mut S) -> Flight;
}

/// Which part of a piece a random point of it lies behind.
#[inline(always)]
fn random_part(word: u32) -> f32 {
    rounding(word.rotate_left(16))
}

/// Voxel by voxel along a line from t0 to t1, scoring weight times length.
#[inline(always)]
fn score_track<const C: usize, S: Scorer<C>>(
    field: &Field,
    p: V3,
    v: V3,
    (t0, t1): (f32, f32),
    w: [f32; C],
    word: u32,
    scorer: &mut S,
) {
    let (mut t, end) = (0.0f32, t1 - t0);
    if end <= 0.0 {
        return;
    }
    let from = along(p, v, t0);
    let mut cells = Dda::new(from, v, [0; 3], field.n());
    let mut word = word;
    loop {
        let (axis, exit) = cells.exit();
        let stop = exit.min(end);
        if stop > t {
            let index = field.index(cells.cell);
            word = word.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            let value = w.map(|x| x * (stop - t));
            scorer.score(index, along(from, v, 0.5 * (t + stop)), value, rounding(word));
            if scorer.absorbs() {
                let there = along(from, v, t + random_part(word) * (stop - t));
                scorer.absorb(index, there, field.at(there), value, rounding(word));
            }
            t = stop;
        }
        if exit >= end || !cells.advance(axis) {
            return;
        }
    }
}

/// Null collisions against the majorant grid.
pub struct Woodcock<'a, const CHROMATIC: bool> {
    /// The density.
    pub field: Field<'a>,
    /// Majorants, already times the largest extinction and rounded up; high enough for the voxels' scores.
    pub majorant: Vec<f32>,
    /// Cells along x, y, z.
    pub cells: [i32; 3],
    /// Voxels per cell and axis.
    pub block: i32,
    /// Largest extinction.
    pub extinction: f32,
    /// Extinction of each channel over the largest.
    pub ratio: [f32; 3],
    /// How each cell scores.
    pub score: Vec<CellScore>,
}

/// How the voxels of a majorant cell are scored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CellScore {
    /// Not at all.
    Nothing,
    /// weight / majorant at tentative collisions.
    Collisions,
    /// weight * length along the flight, where tentative collisions are rare or impossible.
    Track,
}

impl<'a, const CHROMATIC: bool> Woodcock<'a, CHROMATIC> {
    /// From the plan's grid.
    pub fn new(plan: &Plan<'a>, grid: &MajorantGrid) -> Self {
        let medium = &plan.scene.medium;
        let field = Field::density(&medium.volume);
        let extinction = medium.extinction.rgb;
        let voxels = plan.settings.fluence || plan.settings.radiance;
        // For images only what the gather interpolates matters: voxels next to some density, weighted by it.
        let near = (!voxels).then(|| block_maxima(&medium.volume, grid.block, 2));
        let h = medium.volume.spacing().into_iter().fold(f64::INFINITY, f64::min);
        let score = (0..grid.density.len())
            .map(|cell| {
                let depth = f64::from(grid.density[cell]) * medium.extinction.max() * h;
                match &near {
                    _ if plan.layers.is_empty() => CellScore::Nothing,
                    Some(near) if near[cell] == 0.0 => CellScore::Nothing,
                    Some(_) if depth > 0.0 => CellScore::Collisions,
                    None if depth >= LEAST_SCORED_DEPTH || plan.least_depth.is_some() => CellScore::Collisions,
                    _ => CellScore::Track,
                }
            })
            .collect();
        let top = extinction.iter().fold(0.0f64, |m, &e| m.max(e));
        let least = plan.least_depth.map_or(0.0, |depth| depth / h);
        let majorant = |&density: &f32| ((f64::from(density) * top).max(least) * (1.0 + 1e-6)) as f32;
        let majorant = grid.density.iter().map(majorant).collect();
        Woodcock {
            field,
            majorant,
            cells: grid.n.map(|m| m as i32),
            block: grid.block as i32,
            extinction: top as f32,
            ratio: extinction.map(|e| if top > 0.0 { (e / top) as f32 } else { 0.0 }),
            score,
        }
    }
}

impl<const C: usize, const CHROMATIC: bool> Tracker<C> for Woodcock<'_, CHROMATIC> {
    #[inline(always)]
    fn fly<S: Scorer<C>>(&self, p: V3, v: V3, w: &mut Weights<C>, draws: &mut Draws, scorer: &mut S) -> Flight {
        let scale = 1.0 / self.block as f32;
        let mut cells = Dda::new(p.map(|c| c * scale), v.map(|c| c * scale), [0; 3], self.cells);
        // The last cells may reach over the box.
        let (face, end) = self.field.leave(p, v);
        let constant = self.field.constant();
        let mut words = draws.next4();
        let mut free = exponential(words[0], draws);
        let mut t = 0.0f32;
        loop {
            let c = cells.cell;
            let cell = ((c[2] * self.cells[1] + c[1]) * self.cells[0] + c[0]) as usize;
            let majorant = self.majorant[cell];
            let (axis, exit) = cells.exit();
            let exit = exit.min(end);
            let score = self.score[cell];
            if majorant > 0.0 {
                let inverse = 1.0 / majorant;
                loop {
                    let next = t + free * inverse;
                    if score == CellScore::Track {
                        let piece = (t, next.min(exit));
                        score_track(&self.field, p, v, piece, w.get(), words[3], scorer);
                    }
                    if next >= exit {
                        free -= (exit - t).max(0.0) * majorant;
                        free = free.max(0.0);
                        break;
                    }
                    t = next;
                    // A tentative collision. Kept within the cell's voxels, whose densities the majorant bounds.
                    let at: V3 = std::array::from_fn(|a| {
                        let low = (c[a] * self.block) as f32;
                        let high = ((c[a] + 1) * self.block).min(self.field.n()[a]) as f32;
                        (p[a] + v[a] * t).clamp(low, high * (1.0 - 6e-8))
                    });
                    let density = constant.unwrap_or_else(|| self.field.one_read(at, words[1]));
                    if score == CellScore::Collisions {
                        let voxel = self.field.index(at.map(|x| x as i32));
                        let value = w.get().map(|x| x * inverse);
                        scorer.score(voxel, at, value, rounding(words[3]));
                        if scorer.absorbs() {
                            scorer.absorb(voxel, at, density, value, rounding(words[3]));
                        }
                    }
                    let accept = density * self.extinction * inverse;
                    let xi = uniform(words[2]);
                    if CHROMATIC {
                        if xi <= accept * self.ratio[w.hero] {
                            w.observe(std::array::from_fn(|c| self.ratio[c]));
                            return Flight::Collision(at);
                        }
                        w.observe(std::array::from_fn(|c| (1.0 - accept * self.ratio[c]).max(0.0)));
                    } else if xi <= accept {
                        return Flight::Collision(at);
                    }
                    words = draws.next4();
                    free = exponential(words[0], draws);
                }
            } else if score == CellScore::Track && exit > t {
                score_track(&self.field, p, v, (t, exit), w.get(), words[3], scorer);
            }
            t = t.max(exit);
            if exit >= end || !cells.advance(axis) {
                return Flight::Exit(2 * face + usize::from(v[face] > 0.0));
            }
        }
    }
}

/// Inversion of the running optical depth, exact in voxels of constant density and between voxel centres.
pub struct March<'a, const CHROMATIC: bool> {
    /// The density.
    pub field: Field<'a>,
    /// Extinction per unit of density in each channel.
    pub extinction: [f32; 3],
    /// Whether voxels are scored.
    pub scores: bool,
}

impl<const CHROMATIC: bool> March<'_, CHROMATIC> {
    /// The weights after the column density `column` without a collision.
    #[inline(always)]
    fn survived<const C: usize>(&self, w: &Weights<C>, column: f32) -> Weights<C> {
        let mut after = *w;
        let hero = self.extinction[w.hero];
        // Relative to the hero, whose own chance cancels; kept from overflow where others survive far better.
        after.observe(std::array::from_fn(|c| ((hero - self.extinction[c]) * column).min(60.0).exp()));
        after
    }
}

impl<const C: usize, const CHROMATIC: bool> Tracker<C> for March<'_, CHROMATIC> {
    #[inline(always)]
    fn fly<S: Scorer<C>>(&self, p: V3, v: V3, w: &mut Weights<C>, draws: &mut Draws, scorer: &mut S) -> Flight {
        let n = self.field.n();
        let linear = self.field.linear();
        let words = draws.next4();
        let mut word = words[1];
        let extinction = if CHROMATIC { self.extinction[w.hero] } else { self.extinction[0] };
        let free = exponential(words[0], draws);
        // With interpolation the walk steps over half voxels: each lies in one voxel and in one cell between centres.
        let (scale, per_voxel) = if linear { (2.0, 2) } else { (1.0, 1) };
        let mut cells = Dda::new(p.map(|c| c * scale), v.map(|c| c * scale), [0; 3], n.map(|m| m * per_voxel));
        let (mut t, mut column) = (0.0f32, 0.0f32);
        loop {
            let (axis, exit) = cells.exit();
            let voxel = cells.cell.map(|c| c / per_voxel);
            let length = (exit - t).max(0.0);
            let (piece, collision) = if linear {
                let between = cells.cell.map(|c| (c - 1).div_euclid(2));
                let corners = self.field.corners(between);
                let value = |t: f32| corners.at(local(along(p, v, t), between));
                let piece = (value(t) + 4.0 * value(t + 0.5 * length) + value(t + length)) * (length * (1.0 / 6.0));
                let left = free - column * extinction;
                let hit = piece * extinction >= left && piece > 0.0 && length > 0.0;
                let at = hit.then(|| self.field.invert(&corners, between, p, v, (t, exit), left.max(0.0) / extinction));
                (piece, at)
            } else {
                let density = self.field.voxel(voxel);
                let left = free - column * extinction;
                let hit = density * length * extinction >= left && density > 0.0 && length > 0.0;
                (density * length, hit.then(|| (t + left.max(0.0) / (density * extinction)).min(exit)))
            };
            let stop = collision.unwrap_or(exit.max(t));
            if self.scores && stop > t {
                word = word.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
                let middle = along(p, v, 0.5 * (t + stop));
                let weight = if CHROMATIC {
                    // The weight changes along the piece: taken at a random point of it, which is unbiased.
                    let part = random_part(word) * (stop - t) / length.max(1e-30);
                    self.survived(w, column + self.partial(&cells, p, v, (t, exit), part, piece)).get()
                } else {
                    w.get()
                };
                let (index, value) = (self.field.index(voxel), weight.map(|x| x * (stop - t)));
                scorer.score(index, middle, value, rounding(word));
                if scorer.absorbs() {
                    // The same point as the weight's.
                    let there = along(p, v, t + random_part(word) * (stop - t));
                    scorer.absorb(index, there, self.field.at(there), value, rounding(word));
                }
            }
            if let Some(at) = collision {
                if CHROMATIC {
                    *w = self.survived(w, free / extinction);
                    w.observe(std::array::from_fn(|c| self.extinction[c] / extinction));
                }
                let end: V3 = std::array::from_fn(|a| (p[a] + v[a] * at).clamp(0.0, n[a] as f32 * (1.0 - 6e-8)));
                return Flight::Collision(end);
            }
            column += piece;
            t = t.max(exit);
            if !cells.advance(axis) {
                if CHROMATIC {
                    *w = self.survived(w, column);
                }
                return Flight::Exit(cells.face(axis));
            }
        }
    }
}

impl<const CHROMATIC: bool> March<'_, CHROMATIC> {
    /// The column density over the first `part` of the piece from t0 to t1, whose whole is `piece`.
    #[inline(always)]
    fn partial(&self, cells: &Dda, p: V3, v: V3, (t0, t1): (f32, f32), part: f32, piece: f32) -> f32 {
        if !self.field.linear() {
            return piece * part;
        }
        let between = cells.cell.map(|c| (c - 1).div_euclid(2));
        let corners = self.field.corners(between);
        let value = |t: f32| corners.at(local(along(p, v, t), between));
        let end = t0 + part * (t1 - t0);
        (value(t0) + 4.0 * value(0.5 * (t0 + end)) + value(end)) * ((end - t0) * (1.0 / 6.0))
    }
}

/// Free flights in closed form through a homogeneous box.
pub struct Analytic<'a> {
    /// The density.
    pub field: Field<'a>,
    /// The extinction coefficient.
    pub sigma_t: f32,
    /// How flights score.
    pub score: Score,
    /// Whether voxels are scored.
    pub scores: bool,
}

impl<const C: usize> Tracker<C> for Analytic<'_> {
    #[inline(always)]
    fn fly<S: Scorer<C>>(&self, p: V3, v: V3, w: &mut Weights<C>, draws: &mut Draws, scorer: &mut S) -> Flight {
        let words = draws.next4();
        let n = self.field.n();
        let (axis, exit) = self.field.leave(p, v);
        let free = exponential(words[0], draws) / self.sigma_t.max(1e-30);
        let stop = free.min(exit);
        if self.scores && self.score == Score::Track {
            score_track(&self.field, p, v, (0.0, stop), w.get(), words[3], scorer);
        }
        if free >= exit {
            return Flight::Exit(2 * axis + usize::from(v[axis] > 0.0));
        }
        let at: V3 = std::array::from_fn(|a| (p[a] + v[a] * free).clamp(0.0, n[a] as f32 * (1.0 - 6e-8)));
        if self.scores && self.score == Score::Collisions {
            let index = self.field.index(at.map(|x| x as i32));
            let value = w.get().map(|x| x / self.sigma_t);
            scorer.score(index, at, value, rounding(words[3]));
            if scorer.absorbs() {
                scorer.absorb(index, at, self.field.at(at), value, rounding(words[3]));
            }
        }
        Flight::Collision(at)
    }
}

/// Where a line from outside (or inside) first is in the box, in voxel coordinates: entry parameter and length within.
pub fn enter(p: [f64; 3], v: [f64; 3], n: [i32; 3]) -> Option<(f64, f64)> {
    let (t0, t1) = box_range(p, v, n.map(f64::from))?;
    let t0 = t0.max(0.0);
    (t1 > t0).then_some((t0, t1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::frame::sphere;
    use crate::plan::{Method, Settings};
    use crate::scene::{Albedo, Camera, Medium, Scene, Spectrum, Volume};

    /// Counts scores.
    struct Count(u32);

    impl Scorer<3> for Count {
        fn score(&mut self, _: usize, _: V3, _: [f32; 3], _: f32) {
            self.0 += 1;
        }

        fn absorbs(&self) -> bool {
            false
        }

        fn absorb(&mut self, _: usize, _: V3, _: f32, _: [f32; 3], _: f32) {}
    }

    /// Scores of some flights through a box in voxels `finer` than 16 along x.
    fn scores(finer: usize, photons: u64) -> f64 {
        let n = [16, 24, 20].map(|n| n * finer);
        let density = vec![1.0; n.iter().product()];
        let volume = Volume::new(&density, n, [1.0 / (16 * finer) as f64; 3], [0.0; 3], false).expect("valid");
        let spectrum = |v: &[f64]| Spectrum::new(v, "value").expect("valid");
        let phase = crate::physics::Phase::Isotropic;
        let medium = Medium::new(volume, spectrum(&[3.0, 4.0, 5.0]), Albedo::Constant(spectrum(&[0.9])), phase);
        let camera = Camera::perspective([3.0, -3.0, 2.0], [0.5; 3], [0.0, 0.0, 1.0], 20.0, [9, 9]).expect("valid");
        let light = crate::scene::Light::environment(&[1.0]).expect("valid");
        let scene = Scene::new(medium.expect("valid"), vec![light], camera);
        let method = Some(Method::Photon);
        let settings = Settings { method, photons: Some(photons), fluence: true, image: false, ..Settings::default() };
        let plan = Plan::new(&scene, &settings).expect("it can be planned");
        let tracker = Woodcock::<true>::new(&plan, plan.majorant.as_ref().expect("it has one"));
        let mut count = Count(0);
        for photon in 0..2000 {
            let mut draws = Draws::new([7, 0], photon, 0);
            let words = draws.next4();
            let v = sphere(uniform(words[0]), uniform(words[1])).map(|c| c * (16 * finer) as f32);
            let mut weights = Weights::new([1.0; 3], words[2]);
            tracker.fly(n.map(|n| 0.5 * n as f32), v, &mut weights, &mut draws, &mut count);
        }
        f64::from(count.0)
    }

    #[test]
    fn scores_of_a_flight_do_not_grow_with_the_number_of_voxels() {
        let [coarse, fine, few] = [(1, 20_000_000), (4, 20_000_000), (4, 20_000)].map(|(f, n)| scores(f, n));
        assert!(fine < 1.2 * coarse, "{coarse} scores, {fine} in fine voxels");
        // Few photons need more of them.
        assert!(few > 2.0 * fine, "{few} scores of few photons, {fine} of many");
    }
}
