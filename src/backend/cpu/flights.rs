//! Flights in lanes: [`N`] photons or paths as a structure of arrays, taken together from one tentative collision to the
//! next. Each phase of an event is a loop over the lanes without a branch, which becomes vector instructions; reads of the
//! volume are loops of their own.
//!
//! Flights are null-collision flights (Woodcock) below one majorant or a grid of them. In homogeneous media the majorant is
//! the extinction itself, and every collision is real.
//!
//! Four random words an event: the free flight; the jitter of the density's one read, and two bits for roulette; the
//! acceptance, whose position within the accepted part is again uniform and gives the scattering angle; the azimuth, and
//! ten bits that extend the flight's word beyond 32 bits. All bits of the last word together round what the event leaves
//! in the tallies: that depends on none of them (but for the ten in flights that one photon in millions makes).

use super::course::{Cells, Course, Voids};
use crate::physics::Real;
use crate::physics::frame::{rotate, sphere};
use crate::physics::real::cell;
use crate::physics::rng::{uniform, words};
use crate::scene::field::jitter;

/// Flights taken together.
pub const N: usize = 32;
/// All lanes, as bits.
pub const ALL: u32 = (1u32 << (N - 1) << 1).wrapping_sub(1);
/// Lanes that may wait between two cells while the others collide.
const FLYING: u32 = N as u32 / 4;

/// One value per lane.
pub type Row<T> = [T; N];

/// The flights that are under way.
#[repr(C, align(64))]
pub struct Flights {
    /// Voxel coordinates.
    pub p: [Row<f32>; 3],
    /// Unit directions.
    pub d: [Row<f32>; 3],
    /// Whose random numbers they draw.
    pub index: [Row<u32>; 2],
    /// Blocks of random words used.
    pub block: Row<u32>,
    /// Random words of this event.
    pub word: [Row<u32>; 4],
    /// Uniform numbers for the scattering angle.
    pub xi: Row<f32>,
    /// What is left of the free flight, in optical depths of the majorant.
    depth: Row<f32>,
    /// Cell of the majorant grid, and its majorant.
    at: [Row<i32>; 3],
    majorant: Row<f32>,
    /// 1 / majorant where the lane is [length].
    pub free_path: Row<f32>,
    /// The next tentative collision.
    pub q: [Row<f32>; 3],
    /// Voxel at `q`.
    pub voxel: Row<u32>,
    /// The voxel that its density is read from.
    read: Row<u32>,
    /// Cell of the majorants or voids at `q`.
    cell: Row<u32>,
    density: Row<f32>,
}

impl Flights {
    /// Lanes that hold nothing yet.
    pub fn new(course: &Course) -> Self {
        Flights {
            p: [[0.5; N]; 3],
            d: [[0.0; N], [0.0; N], [1.0; N]],
            index: [[0; N]; 2],
            block: [0; N],
            word: [[0; N]; 4],
            xi: [0.5; N],
            depth: [0.0; N],
            at: [[0; N]; 3],
            majorant: [1.0; N],
            free_path: [course.free_path; N],
            q: [[0.5; N]; 3],
            voxel: [0; N],
            read: [0; N],
            cell: [0; N],
            density: [course.field.constant().unwrap_or(0.0); N],
        }
    }

    /// The next four words of some lanes, and a tentative flight of all that are `alive`; gives those that are at a
    /// tentative collision. `flying` are those between two cells of majorants.
    #[inline(always)]
    pub fn advance(&mut self, course: &Course, alive: u32, flying: &mut u32) -> u32 {
        self.draw(course, alive & !*flying);
        match &course.cells {
            None => self.fly(course) & alive,
            Some(cells) => self.cross(course, cells, alive, flying),
        }
    }

    /// The albedos at the real collisions of some lanes, by channel.
    #[inline(always)]
    pub fn albedos<const C: usize>(&self, course: &Course, hit: u32) -> [Row<f32>; C] {
        let mut albedo = [[0.0f32; N]; C];
        for c in 0..C {
            albedo[c] = [course.medium.constant[c]; N];
        }
        if let Some(field) = &course.medium.field {
            for lane in bits(hit) {
                let p = std::array::from_fn(|a| self.p[a][lane]);
                let index = [self.index[0][lane], self.index[1][lane]];
                let value = field.one_read(p, words(course.seed, index, self.block[lane], course.purpose + 1)[0]);
                for c in 0..C {
                    albedo[c][lane] = value;
                }
            }
        }
        albedo
    }

    /// The relative absorption at the tentative collisions of some lanes, whose density has been read.
    #[inline(always)]
    pub fn absorption(&self, course: &Course, which: u32) -> Row<f32> {
        let mut relative = [0.0; N];
        for lane in bits(which) {
            let q = [0, 1, 2].map(|a| self.q[a][lane]);
            relative[lane] = course.medium.relative_absorption(q, self.density[lane]);
        }
        relative
    }

    /// Scatters some lanes into a new direction.
    #[inline(always)]
    pub fn turn(&mut self, course: &Course, hit: u32) {
        if course.isotropic {
            for i in 0..N {
                let d = sphere(self.xi[i], azimuth(self.word[3][i]));
                for a in 0..3 {
                    self.d[a][i] = if hit >> i & 1 == 1 { d[a] } else { self.d[a][i] };
                }
            }
        } else {
            let (cos_theta, sin_theta) = course.phase.sample_lanes(&self.xi);
            for i in 0..N {
                let before = [self.d[0][i], self.d[1][i], self.d[2][i]];
                let d = rotate(before, cos_theta[i], sin_theta[i], azimuth(self.word[3][i]));
                for a in 0..3 {
                    self.d[a][i] = if hit >> i & 1 == 1 { d[a] } else { before[a] };
                }
            }
        }
    }

    /// Whether a lane survives roulette with the chance of a quarter.
    #[inline(always)]
    pub fn survives(&self, lane: usize) -> bool {
        self.word[1][lane] >> 30 == 0
    }

    /// The next four words of some lanes, and the free flight that they begin with.
    #[inline(always)]
    fn draw(&mut self, course: &Course, which: u32) {
        for i in 0..N {
            let takes = which >> i & 1 == 1;
            let word = words(course.seed, [self.index[0][i], self.index[1][i]], self.block[i], course.purpose);
            for k in 0..4 {
                self.word[k][i] = if takes { word[k] } else { self.word[k][i] };
            }
            self.block[i] += u32::from(takes);
        }
        for i in 0..N {
            let depth = flight(self.word[0][i], self.word[3][i]);
            self.depth[i] = if which >> i & 1 == 1 { depth } else { self.depth[i] };
        }
    }

    /// Free flights to `q`; gives the lanes that are still in the box.
    #[inline(always)]
    fn fly(&mut self, course: &Course) -> u32 {
        let n = course.field.n();
        let mut inside = [false; N];
        for i in 0..N {
            let length = self.depth[i] * course.free_path;
            let mut within = true;
            for a in 0..3 {
                let q = self.p[a][i] + self.d[a][i] * course.medium.inverse_h[a] * length;
                self.q[a][i] = q;
                within &= q >= 0.0 && q < n[a] as f32;
            }
            inside[i] = within;
        }
        if course.field.is_ball() {
            for i in 0..N {
                let mut r2 = 0.0f32;
                for a in 0..3 {
                    let r = self.q[a][i] - 0.5;
                    r2 += r * r;
                }
                inside[i] = r2 < 0.25;
            }
        }
        mask(|i| inside[i])
    }

    /// Moves the lanes `alive` on through the cells of majorants, until few of them are still `flying`; gives those at a
    /// tentative collision.
    #[inline(always)]
    fn cross(&mut self, course: &Course, cells: &Cells, alive: u32, flying: &mut u32) -> u32 {
        let n = course.field.n();
        let scale = 1.0 / cells.block;
        for i in 0..N {
            // A photon that is about to fly finds its cell; a flying one is in the cell that it came to.
            let starts = *flying >> i & 1 == 0;
            for a in 0..3 {
                let here = cell(Real::max(self.p[a][i], 0.0) * scale);
                let here = if here < cells.n[a] { here } else { cells.n[a] - 1 };
                self.at[a][i] = if starts { here } else { self.at[a][i] };
            }
        }
        *flying = alive;
        let mut inside = 0;
        loop {
            for i in 0..N {
                self.cell[i] = flat([0, 1, 2].map(|a| self.at[a][i] as u32), [cells.n[0] as u32, cells.n[1] as u32]);
            }
            for lane in bits(*flying) {
                self.majorant[lane] = cells.majorant[self.cell[lane] as usize];
            }
            let mut stops = [false; N];
            let mut leaves = [false; N];
            for i in 0..N {
                let flies = *flying >> i & 1 == 1;
                let mut edge = [0.0f32; 3];
                let mut way = [0.0f32; 3];
                let mut v = [0.0f32; 3];
                for a in 0..3 {
                    v[a] = self.d[a][i] * course.medium.inverse_h[a];
                    let next = self.at[a][i] + i32::from(v[a] > 0.0);
                    edge[a] = Real::min(next as f32 * cells.block, n[a] as f32);
                    let t = Real::max((edge[a] - self.p[a][i]) / v[a], 0.0);
                    way[a] = if v[a] == 0.0 { f32::INFINITY } else { t };
                }
                let exit = Real::min(way[0], Real::min(way[1], way[2]));
                let free = self.depth[i] / self.majorant[i];
                let stop = free < exit;
                let t = if stop { free } else { exit };
                let rest = Real::max(self.depth[i] - t * self.majorant[i], 0.0);
                self.depth[i] = if flies { rest } else { self.depth[i] };
                let mut out = false;
                let mut open = !stop;
                for a in 0..3 {
                    // The axis of the face that is crossed.
                    let crosses = open && way[a] == exit;
                    open = open && !crosses;
                    // Rounding must not carry a tentative collision out of the cell whose majorant it has.
                    let low = self.at[a][i] as f32 * cells.block;
                    let high = Real::min(low + cells.block, n[a] as f32) * (1.0 - 6e-8);
                    let p = Real::max(Real::min(self.p[a][i] + v[a] * t, high), low);
                    let p = if crosses { edge[a] } else { p };
                    self.p[a][i] = if flies { p } else { self.p[a][i] };
                    let next = self.at[a][i] + if v[a] > 0.0 { 1 } else { -1 };
                    let moves = flies && crosses;
                    let outside = next < 0 || next >= cells.n[a];
                    out |= moves && outside;
                    self.at[a][i] = if moves && !outside { next } else { self.at[a][i] };
                }
                stops[i] = flies && stop;
                leaves[i] = out;
            }
            let (stopped, left) = (mask(|i| stops[i]), mask(|i| leaves[i]));
            inside |= stopped;
            *flying &= !stopped & !left;
            if flying.count_ones() <= FLYING {
                break;
            }
        }
        for i in 0..N {
            self.free_path[i] = 1.0 / self.majorant[i];
        }
        self.q = self.p;
        inside
    }

    /// Finds the voxels of the tentative collisions.
    #[inline(always)]
    pub fn locate(&mut self, course: &Course) {
        let n = course.field.n();
        for i in 0..N {
            let c = [0, 1, 2].map(|a| cell(self.q[a][i]) as u32);
            self.voxel[i] = flat(c, [n[0] as u32, n[1] as u32]);
        }
    }

    /// The lanes whose tentative collisions are not in a void.
    #[inline(always)]
    pub fn dense(&mut self, voids: &Voids) -> u32 {
        for i in 0..N {
            self.cell[i] = flat([0, 1, 2].map(|a| cell(self.q[a][i]) as u32 >> voids.shift), voids.n);
        }
        mask(|i| voids.empty.get(self.cell[i] as usize) == Some(&false))
    }

    /// Makes every tentative collision real.
    #[inline(always)]
    pub fn accept_all(&mut self) {
        self.p = self.q;
        for i in 0..N {
            self.xi[i] = uniform(self.word[2][i]);
        }
    }

    /// Moves all lanes to their tentative collisions; gives those of `dense` where it is real.
    #[inline(always)]
    pub fn accept(&mut self, course: &Course, dense: u32) -> u32 {
        let n = course.field.n();
        self.p = self.q;
        let spread = if course.field.linear() { 1.0f32 } else { 0.0 };
        for i in 0..N {
            let word = self.word[1][i];
            let c: [u32; 3] = std::array::from_fn(|a| {
                let q = Real::max(self.q[a][i] + spread * jitter(word, a), 0.0);
                cell(Real::min(q, n[a] as f32 - 0.5)) as u32
            });
            self.read[i] = flat(c, [n[0] as u32, n[1] as u32]);
        }
        let values = course.field.values();
        self.density = [0.0; N];
        for lane in bits(dense) {
            self.density[lane] = values[self.read[lane] as usize];
        }
        let mut hit = [false; N];
        for i in 0..N {
            let accept = self.density[i] * course.extinction * self.free_path[i];
            let xi = uniform(self.word[2][i]);
            hit[i] = xi <= accept;
            self.xi[i] = Real::min(xi / accept, 1.0);
        }
        mask(|i| hit[i]) & dense
    }
}

/// The set bits of a mask.
#[inline(always)]
pub fn bits(mut mask: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (mask != 0).then(|| {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            lane
        })
    })
}

/// The lanes for which a flag holds, as bits.
#[inline(always)]
pub fn mask(flag: impl Fn(usize) -> bool) -> u32 {
    let mut mask = 0;
    for i in 0..N {
        mask |= u32::from(flag(i)) << i;
    }
    mask
}

/// The index of a cell of a grid with the given numbers of cells along x and y; any number for a lane that holds nothing.
#[inline(always)]
fn flat(c: [u32; 3], n: [u32; 2]) -> u32 {
    c[2].wrapping_mul(n[1]).wrapping_add(c[1]).wrapping_mul(n[0]).wrapping_add(c[0])
}

/// A free flight in mean free paths, from 32 bits and ten more behind them: up to 28 mean free paths.
#[inline(always)]
fn flight(word: u32, more: u32) -> f32 {
    let rest = ((more & 1023) as f32 + 0.5) * (1.0 / 1024.0);
    -Real::ln((word as f32 + rest) * (1.0 / 4_294_967_296.0))
}

/// A part of a turn from the upper 22 bits.
#[inline(always)]
fn azimuth(word: u32) -> f32 {
    (word >> 10) as f32 * (1.0 / 4_194_304.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flights_are_the_logarithm_of_all_42_bits() {
        let exact = |word: u32, more: u32| {
            let rest = (f64::from(more & 1023) + 0.5) / 1024.0;
            -((f64::from(word) + rest) / 4_294_967_296.0).ln()
        };
        let words = (0..64).chain((0..32).map(|bit| (1 << bit) + 3)).chain((0..99).map(|i| i * 43_383_508 + 17));
        for word in words.chain([u32::MAX - 300, u32::MAX]) {
            for more in [0, 1, 511, 1023, 1024 + 77] {
                let (value, truth) = (f64::from(flight(word, more)), exact(word, more));
                // The word itself is rounded to 24 bits, 6e-8 of it; the logarithm is good to as much of its value.
                assert!((value - truth).abs() < 1.5e-7 * truth.max(1.0), "{word} {more}: {value} and not {truth}");
            }
        }
        assert!(flight(0, 0) > 29.0);
    }
}
