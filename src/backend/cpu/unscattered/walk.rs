//! What the light of one ray leaves on its way through the box, exact however thick the voxels are: the integral of its
//! transmittance over its way in each voxel, and what of it is absorbed there.
//!
//! In a voxel of constant density both have closed forms. Between voxel centres the density is cubic along the ray, its
//! integral quartic; pieces of small optical depth are integrated by Simpson's rule, whose three transmittances are exact.

use crate::scene::field::{Corners, Field};
use crate::scene::{Albedo, Scene};

/// Light below exp(-40) of what it was is not followed, unless its whole way is to be known.
pub const DARK: f64 = 4.25e-18;
/// Largest optical depth of a piece of Simpson's rule.
const PIECE: f64 = 0.3;
/// No piece is shorter than this part of its way through half a voxel.
const SHORTEST: f64 = 1e-9;

/// A way through the box: `p + t v` for t from 0 to `length`, in voxel coordinates.
#[derive(Debug, Clone, Copy)]
pub struct Way {
    /// Where it begins.
    pub p: [f64; 3],
    /// Voxels per unit of length.
    pub v: [f64; 3],
    /// Its length.
    pub length: f64,
}

/// What light of weight 1 leaves in a voxel, by extinction.
#[derive(Debug, Clone, Copy)]
pub struct Stay<const K: usize> {
    /// The integral of the transmittance over the way in the voxel.
    pub path: [f64; K],
    /// What is absorbed; where the albedo is constant, all that collides.
    pub absorbed: [f64; K],
    /// The way.
    pub length: f64,
}

impl<const K: usize> Stay<K> {
    const ZERO: Self = Stay { path: [0.0; K], absorbed: [0.0; K], length: 0.0 };
}

/// What becomes of light of weight 1, by extinction.
#[derive(Debug, Clone, Copy)]
pub struct Fate<const K: usize> {
    /// What leaves the box.
    pub through: [f64; K],
    /// What is absorbed; where the albedo is constant, all that collides.
    pub absorbed: [f64; K],
    /// What is scattered; where the albedo is constant, nothing.
    pub scattered: [f64; K],
}

impl<const K: usize> Fate<K> {
    /// Nothing.
    pub const ZERO: Self = Fate { through: [0.0; K], absorbed: [0.0; K], scattered: [0.0; K] };
    /// Light that has not met anything.
    const FRESH: Self = Fate { through: [1.0; K], ..Self::ZERO };

    /// Adds the fate of light of a weight.
    pub fn add(&mut self, other: &Self, weight: f64) {
        for c in 0..K {
            self.through[c] += weight * other.through[c];
            self.absorbed[c] += weight * other.absorbed[c];
            self.scattered[c] += weight * other.scattered[c];
        }
    }

    /// Light of a channel collides: of what there is the part `lost`, of which the part `coalbedo` is absorbed.
    #[inline(always)]
    fn collide(&mut self, c: usize, lost: f64, coalbedo: f64) -> f64 {
        let lost = self.through[c] * lost;
        let absorbed = lost * coalbedo;
        self.absorbed[c] += absorbed;
        self.scattered[c] += lost - absorbed;
        self.through[c] -= lost;
        absorbed
    }
}

/// What light meets: `K` extinctions, 1 where all channels have the same.
#[derive(Debug, Clone, Copy)]
pub struct Matter<'a, const K: usize> {
    density: Field<'a>,
    /// The albedo, where it is not constant.
    albedo: Option<Field<'a>>,
    extinction: [f64; K],
}

/// Optical depths up to which a series is used.
const THIN: f64 = 0.35;

/// The chance of a collision within an optical depth.
#[inline(always)]
fn chance(tau: f64) -> f64 {
    if tau < THIN { tau * thin_mean(tau) } else { thick_chance(tau) }
}

/// The same, kept apart from the loops that seldom need it.
#[cold]
#[inline(never)]
fn thick_chance(tau: f64) -> f64 {
    1.0 - (-tau).exp()
}

/// The mean transmittance over an optical depth up to [`THIN`]: (1 - exp(-tau)) / tau. The next term of its series is below
/// 3e-11; terms are taken in pairs, which do not wait for each other.
#[inline(always)]
fn thin_mean(tau: f64) -> f64 {
    let (a, b) = (1.0 - tau * (1.0 / 2.0), 1.0 / 6.0 - tau * (1.0 / 24.0));
    let (c, d) = (1.0 / 120.0 - tau * (1.0 / 720.0), 1.0 / 5040.0 - tau * (1.0 / 40_320.0));
    let tau2 = tau * tau;
    let tau4 = tau2 * tau2;
    (a + tau2 * b) + tau4 * ((c + tau2 * d) + tau4 * (1.0 / 362_880.0))
}

/// The planes that a way crosses, of a grid with `cells` cells per voxel and axis.
struct Planes {
    cell: [i32; 3],
    step: [i32; 3],
    next: [f64; 3],
    delta: [f64; 3],
}

impl Planes {
    fn new(way: &Way, n: [i32; 3], cells: i32) -> Self {
        let mut planes = Planes { cell: [0; 3], step: [0; 3], next: [f64::INFINITY; 3], delta: [f64::INFINITY; 3] };
        for a in 0..3 {
            let (q, v) = (way.p[a] * f64::from(cells), way.v[a] * f64::from(cells));
            let cell = q.floor();
            // A way down from a plane begins below it.
            let below = v < 0.0 && q == cell;
            let cell = (cell as i32 - i32::from(below)).clamp(0, n[a] * cells - 1);
            planes.cell[a] = cell;
            if v != 0.0 {
                planes.step[a] = if v > 0.0 { 1 } else { -1 };
                planes.next[a] = ((f64::from(cell + i32::from(v > 0.0)) - q) / v).max(0.0);
                planes.delta[a] = v.recip().abs();
            }
        }
        planes
    }

    /// The axis whose plane is crossed next, and where.
    #[inline(always)]
    fn exit(&self) -> (usize, f64) {
        let [x, y, z] = self.next;
        let (axis, across) = if x < y { (0, x) } else { (1, y) };
        if across < z { (axis, across) } else { (2, z) }
    }
}

/// The density and the albedo along a way through a cell between voxel centres, as cubics.
struct Cell {
    /// Where the way enters it.
    start: f64,
    density: [f64; 4],
    albedo: Option<[f64; 4]>,
}

impl<'a, const K: usize> Matter<'a, K> {
    /// That of a scene.
    pub fn new(scene: &Scene<'a>) -> Self {
        let medium = &scene.medium;
        let albedo = match medium.albedo {
            Albedo::PerVoxel(values) => Some(Field::new(values, &medium.volume)),
            Albedo::Constant(_) => None,
        };
        let extinction = std::array::from_fn(|c| medium.extinction.rgb[c]);
        Matter { density: Field::density(&medium.volume), albedo, extinction }
    }

    /// What becomes of the light of a way.
    pub fn fate(&self, way: &Way) -> Fate<K> {
        match (self.density.constant(), &self.albedo) {
            (Some(density), None) => {
                let column = f64::from(density) * way.length;
                let mut fate = Fate::FRESH;
                (0..K).for_each(|c| _ = fate.collide(c, chance(self.extinction[c] * column), 1.0));
                fate
            }
            _ => self.walk(way, DARK, |_, _| {}),
        }
    }

    /// What of the light of a way leaves the box, in single precision; nothing is said of the rest.
    pub fn passage(&self, way: &Way) -> Fate<K> {
        let single = |v: [f64; 3]| v.map(|c| c as f32);
        // What is dark in all channels is dark.
        let enough = self.extinction.iter().fold(0.0f64, |most, &e| most.max(40.0 / e)) as f32;
        let column = self.density.column_up_to(single(way.p), single(way.v), way.length as f32, enough);
        Fate { through: self.extinction.map(|e| (-e * f64::from(column)).exp()), ..Fate::ZERO }
    }

    /// Follows the light of a way until all of it is below `dark`; `leave(voxel, stay)` is told what it leaves in each voxel.
    #[inline(always)]
    pub fn walk(&self, way: &Way, dark: f64, leave: impl FnMut([i32; 3], &Stay<K>)) -> Fate<K> {
        if self.density.linear() && (self.density.constant().is_none() || self.albedo.is_some()) {
            self.walk_cells(way, dark, leave)
        } else {
            self.walk_voxels(way, dark, leave)
        }
    }

    /// The walk through voxels of constant density.
    #[inline(always)]
    fn walk_voxels(&self, way: &Way, dark: f64, mut leave: impl FnMut([i32; 3], &Stay<K>)) -> Fate<K> {
        let n = self.density.n();
        let mut planes = Planes::new(way, n, 1);
        let mut fate = Fate::FRESH;
        let mut t = 0.0;
        loop {
            let (axis, exit) = planes.exit();
            let stop = exit.min(way.length);
            if stop > t {
                let (step, cell) = (stop - t, planes.cell);
                let density = f64::from(self.density.voxel(cell));
                let coalbedo = self.albedo.as_ref().map_or(1.0, |albedo| 1.0 - f64::from(albedo.voxel(cell)));
                let mut stay = Stay { length: step, ..Stay::ZERO };
                for c in 0..K {
                    let tau = self.extinction[c] * density * step;
                    let (mean, lost) = if tau < THIN {
                        let mean = thin_mean(tau);
                        (mean, tau * mean)
                    } else {
                        let lost = thick_chance(tau);
                        (lost / tau, lost)
                    };
                    stay.path[c] = fate.through[c] * step * mean;
                    stay.absorbed[c] = fate.collide(c, lost, coalbedo);
                }
                leave(cell, &stay);
                t = stop;
            }
            if exit >= way.length || fate.through.iter().all(|&through| through < dark) {
                return fate;
            }
            planes.cell[axis] += planes.step[axis];
            planes.next[axis] += planes.delta[axis];
            if planes.cell[axis] < 0 || planes.cell[axis] >= n[axis] {
                return fate;
            }
        }
    }

    /// The walk through halves of voxels, in each of which density and albedo are cubic.
    #[inline(always)]
    fn walk_cells(&self, way: &Way, dark: f64, mut leave: impl FnMut([i32; 3], &Stay<K>)) -> Fate<K> {
        let n = self.density.n();
        let most = self.extinction.iter().fold(0.0f64, |most, &e| most.max(e));
        let mut planes = Planes::new(way, n, 2);
        let mut fate = Fate::FRESH;
        let mut stay = Stay::ZERO;
        let mut cell = Cell { start: 0.0, density: [0.0; 4], albedo: None };
        // The column from where the way enters the cell.
        let mut before = 0.0;
        let mut t = 0.0;
        let mut fresh = true;
        loop {
            let (axis, exit) = planes.exit();
            let stop = exit.min(way.length);
            if stop > t {
                if fresh {
                    cell = self.cell(way, planes.cell.map(|half| ((half + 1) >> 1) - 1), t);
                    (before, fresh) = (0.0, false);
                }
                let (from, to) = (t - cell.start, stop - cell.start);
                stay.length += to - from;
                let after = column(&cell.density, to);
                if most * (after - before) <= PIECE {
                    self.simpson(&cell, (from, before), (to, after), &mut fate, &mut stay);
                } else {
                    self.pieces(&cell, (from, before), (to, after), &mut fate, &mut stay);
                }
                (before, t) = (after, stop);
            }
            let half = planes.cell;
            planes.cell[axis] += planes.step[axis];
            planes.next[axis] += planes.delta[axis];
            let done = exit >= way.length
                || planes.cell[axis] < 0
                || planes.cell[axis] >= 2 * n[axis]
                || fate.through.iter().all(|&through| through < dark);
            if done || half[axis] >> 1 != planes.cell[axis] >> 1 {
                leave(half.map(|half| half >> 1), &stay);
                stay = Stay::ZERO;
            } else {
                // Over a plane of voxel centres.
                fresh = true;
            }
            if done {
                return fate;
            }
        }
    }

    /// A cell between voxel centres, which the way enters at `t`.
    #[inline(always)]
    fn cell(&self, way: &Way, cell: [i32; 3], t: f64) -> Cell {
        let corners = self.density.corners(cell);
        if corners.is_zero() {
            return Cell { start: t, density: [0.0; 4], albedo: self.albedo.as_ref().map(|_| [0.0; 4]) };
        }
        let enter = std::array::from_fn(|a| way.p[a] + way.v[a] * t - 0.5 - f64::from(cell[a]));
        let cubic = |corners: Corners| corners.cubic(enter, way.v);
        let albedo = self.albedo.as_ref().map(|albedo| cubic(albedo.corners(cell)));
        Cell { start: t, density: cubic(corners), albedo }
    }

    /// Takes the light on within a cell, in pieces of small optical depth; the ends come with the columns before them.
    #[inline(never)]
    fn pieces(
        &self,
        cell: &Cell,
        (from, first): (f64, f64),
        (to, last): (f64, f64),
        fate: &mut Fate<K>,
        stay: &mut Stay<K>,
    ) {
        let thickest = |fate: &Fate<K>| {
            let alive = |c: usize| if fate.through[c] < DARK { 0.0 } else { self.extinction[c] };
            (0..K).fold(0.0, |most: f64, c| most.max(alive(c)))
        };
        let (mut at, mut step, mut before) = (from, to - from, first);
        loop {
            let end = if at + step < to { at + step } else { to };
            let after = if end < to { column(&cell.density, end) } else { last };
            if step > SHORTEST * (to - from) && thickest(fate) * (after - before) > PIECE {
                step *= 0.5;
                continue;
            }
            self.simpson(cell, (at, before), (end, after), fate, stay);
            if end >= to {
                return;
            }
            (at, before) = (end, after);
            step *= 2.0;
        }
    }

    /// A piece of small optical depth; its ends come with the columns before them.
    #[inline(always)]
    fn simpson(
        &self,
        cell: &Cell,
        (from, before): (f64, f64),
        (to, after): (f64, f64),
        fate: &mut Fate<K>,
        stay: &mut Stay<K>,
    ) {
        let whole = after - before;
        let middle = 0.5 * (from + to);
        let half = column(&cell.density, middle) - before;
        for c in 0..K {
            let (e, through) = (self.extinction[c], fate.through[c]);
            let (halfway, lost) = (chance((e * half).max(0.0)), chance((e * whole).max(0.0)));
            stay.path[c] += through * (to - from) * (1.0 - (4.0 * halfway + lost) * (1.0 / 6.0));
            let coalbedo = match &cell.albedo {
                None => 1.0,
                Some(albedo) => {
                    let nodes = [(from, 1.0), (middle, 4.0 * (1.0 - halfway)), (to, 1.0 - lost)];
                    let (mut all, mut absorbed) = (0.0, 0.0);
                    for (at, weight) in nodes {
                        let weight = weight * value(&cell.density, at).max(0.0);
                        all += weight;
                        absorbed += weight * (1.0 - value(albedo, at));
                    }
                    if all > 0.0 { (absorbed / all).clamp(0.0, 1.0) } else { 0.0 }
                }
            };
            stay.absorbed[c] += fate.collide(c, lost, coalbedo);
        }
    }
}

/// The value of a cubic.
#[inline(always)]
fn value(c: &[f64; 4], s: f64) -> f64 {
    c[0] + s * (c[1] + s * (c[2] + s * c[3]))
}

/// Its integral from 0 to `s`.
#[inline(always)]
fn column(c: &[f64; 4], s: f64) -> f64 {
    s * ((c[0] + s * (c[1] * (1.0 / 2.0))) + s * s * (c[2] * (1.0 / 3.0) + s * (c[3] * (1.0 / 4.0))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chances_are_those_of_an_exponential() {
        for i in 0..400 {
            let tau = 1e-9 * 1.06f64.powi(i);
            let exact = -(-tau).exp_m1();
            assert!((chance(tau) - exact).abs() < 1e-10 * exact, "{tau}: {} {exact}", chance(tau));
        }
    }
}
