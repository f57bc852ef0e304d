//! The photon walk in lanes: [`N`] photons as a structure of arrays, taken together from one tentative collision to the
//! next. Each phase of an event is a loop over the lanes without a branch, which becomes vector instructions; reads of
//! the volume and adds to the tallies are loops of their own. A photon that ends hands its lane to the next at once.
//!
//! Flights are null-collision flights (Woodcock) below one majorant or a grid of them, scored as weight / majorant at
//! every tentative collision. Majorants are high enough for that to happen in every voxel that a photon crosses often
//! enough to have a normal spread: where the medium is thinner, they are raised. In homogeneous media the majorant is the
//! extinction itself, and every collision is real.
//!
//! Four random words an event: the free flight; the jitter of the density's one read, and two bits for roulette; the
//! acceptance, whose position within the accepted part is again uniform and gives the scattering angle; the azimuth, and
//! ten bits that round deposits and extend the flight's word beyond 32 bits.

use super::emit::{Cursor, FirstCollisions, Start};
use super::shoot::{Energies, Engine, Medium, ROULETTE, SURVIVAL, Task, Walk};
use super::simd::{Kernel, best, dispatch};
use crate::physics::frame::{rotate, sphere};
use crate::physics::harmonics::{MAX_ORDER, count, evaluate};
use crate::physics::real::cell;
use crate::physics::rng::{split, uniform, uniform64, words};
use crate::physics::{Phase, Real};
use crate::plan::{LEAST_SCORED_DEPTH, MajorantGrid, Plan, Route, Simd, Tracker};
use crate::result::{EXIT_FACES, Share};
use crate::scene::field::{Field, V3, jitter, leave};
use crate::scene::{Volume, block_maxima};
use crate::tally::Bins;

/// Photons walked together.
const N: usize = 32;
/// Lanes that may wait between two cells while the others collide.
const FLYING: u32 = N as u32 / 4;
/// Events between looks at the clock and the stop flag.
const PATIENCE: u32 = 1 << 12;

/// Walks the photons of a plan in lanes, with `C` channels of equal extinction.
pub struct Laned<'a, const C: usize> {
    simd: Simd,
    field: Field<'a>,
    medium: Medium<'a>,
    phase: &'a Phase,
    isotropic: bool,
    /// Whether every tentative collision is real.
    certain: bool,
    /// 1 / majorant [length], where there is one majorant.
    free_path: f32,
    /// The largest extinction coefficient per density.
    extinction: f32,
    /// The majorants, where there are several.
    cells: Option<Cells>,
    /// Where nothing can collide, if that is looked up.
    voids: Option<Voids>,
    /// Whether what lies there is scored all the same.
    scores_voids: bool,
    last: u32,
    /// Order of the spherical harmonics, if the directions of flight are recorded in these.
    harmonics: Option<usize>,
    routes: [Route; 3],
    seed: [u32; 2],
}

/// A grid of majorants.
struct Cells {
    /// Voxels per cell and axis.
    block: f32,
    n: [i32; 3],
    /// Extinction coefficients that are nowhere exceeded, x fastest.
    majorant: Vec<f32>,
}

impl Cells {
    /// The plan's grid, raised to `least`. For images alone it is raised where the medium is empty but near enough to some
    /// density for the gather to interpolate the source there.
    fn new(plan: &Plan, grid: &MajorantGrid, least: f64) -> Self {
        let medium = &plan.scene.medium;
        let near = block_maxima(&medium.volume, grid.block, Voids::REACH);
        let h = medium.volume.spacing().into_iter().fold(f64::INFINITY, f64::min);
        let majorant = grid.density.iter().zip(near).map(|(&density, near)| {
            let [own, near] = [density, 0.25 * near].map(|d| f64::from(d) * medium.extinction.max());
            (own.max(near.min(LEAST_SCORED_DEPTH / h)).max(least) * (1.0 + 1e-6)) as f32
        });
        Cells { block: grid.block as f32, n: grid.n.map(|m| m as i32), majorant: majorant.collect() }
    }
}

/// Cells of the volume that hold no density, nor have any next to them that an interpolation reads.
struct Voids {
    /// Cells are cubes of 2^shift voxels.
    shift: u32,
    n: [u32; 2],
    empty: Vec<bool>,
}

impl Voids {
    /// Voxels around a cell that an image's interpolation of the source reads, and what the density's own does.
    const REACH: usize = 2;
    /// So many cells stay in the fastest cache.
    const CELLS: usize = 1 << 15;

    /// The voids of a volume, if it has any.
    fn new(volume: &Volume) -> Option<Self> {
        let cells = |shift: u32| volume.n().map(|m| m.div_ceil(1 << shift));
        let shift = (2..16).find(|&shift| cells(shift).iter().product::<usize>() <= Voids::CELLS).unwrap_or(16);
        let maxima = block_maxima(volume, 1 << shift, Voids::REACH);
        let n = cells(shift);
        let empty: Vec<bool> = maxima.iter().map(|&d| d == 0.0).collect();
        empty.contains(&true).then_some(Voids { shift, n: [n[0] as u32, n[1] as u32], empty })
    }
}

impl<'a, const C: usize> Laned<'a, C> {
    /// From a plan.
    pub fn new(plan: &'a Plan<'a>) -> Self {
        let medium = &plan.scene.medium;
        let voxels = plan.settings.fluence || plan.settings.radiance;
        let h = medium.volume.spacing().into_iter().fold(f64::INFINITY, f64::min);
        let sigma_t = medium.max_sigma_t();
        let least = if voxels { LEAST_SCORED_DEPTH / h } else { 0.0 };
        let certain = plan.tracker == Tracker::Analytic && sigma_t >= least;
        // Rounded up, so that no acceptance exceeds one.
        let majorant = if certain { sigma_t } else { sigma_t.max(least) * (1.0 + 1e-6) };
        let grid = plan.majorant.as_ref().filter(|grid| !grid.is_one());
        // Cells have no collisions in voids anyway, and a homogeneous medium has no voids.
        let voids = if grid.is_some() || medium.volume.is_constant() { None } else { Voids::new(&medium.volume) };
        Laned {
            simd: plan.settings.simd.unwrap_or_else(best),
            field: Field::density(&medium.volume),
            medium: Medium::new(plan),
            phase: &medium.phase,
            isotropic: medium.phase.is_isotropic(),
            certain,
            free_path: (1.0 / majorant.max(1e-30)) as f32,
            extinction: medium.extinction.max() as f32,
            cells: grid.map(|grid| Cells::new(plan, grid, least)),
            voids,
            scores_voids: voxels,
            last: plan.walked_orders(),
            harmonics: plan.harmonics,
            routes: plan.routes,
            seed: split(plan.settings.seed),
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

/// One value per lane.
type Row<T> = [T; N];

/// The photons that are under way.
#[repr(C, align(64))]
struct Lanes<const C: usize> {
    /// Voxel coordinates.
    p: [Row<f32>; 3],
    /// Unit directions.
    d: [Row<f32>; 3],
    weight: [Row<f32>; C],
    /// What was absorbed of it so far.
    absorbed: [Row<f32>; C],
    /// Scatterings so far.
    order: Row<u32>,
    index: [Row<u32>; 2],
    /// Blocks of random words used.
    block: Row<u32>,
    /// Random words of this event.
    word: [Row<u32>; 4],
    /// Uniform numbers for the scattering angle.
    xi: Row<f32>,
    /// What is left of the free flight, in optical depths of the majorant.
    depth: Row<f32>,
    /// Cell of the majorant grid, and its majorant.
    at: [Row<i32>; 3],
    majorant: Row<f32>,
    /// 1 / majorant where the lane is [length].
    free_path: Row<f32>,
    /// The next tentative collision.
    q: [Row<f32>; 3],
    /// Voxel at `q`, and the one that its density is read from.
    voxel: [Row<u32>; 2],
    /// Cell of the voids at `q`.
    cell: Row<u32>,
    /// What a tentative collision leaves in its voxel.
    score: [Row<f32>; C],
    density: Row<f32>,
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
        let all = (1u32 << (N - 1) << 1).wrapping_sub(1);
        let (mut dead, mut hit) = (all, 0u32);
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
            let mut alive = all & !dead;
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
            lanes.draw(tables.seed, alive & !flying);
            let inside = match &tables.cells {
                None => lanes.fly(tables) & alive,
                Some(cells) => lanes.cross(tables, cells, alive, &mut flying),
            };
            for lane in bits(alive & !inside & !flying) {
                lanes.escape(lane, tables, energies);
            }
            dead = all & !inside & !flying;
            lanes.locate(tables);
            let dense = tables.voids.as_ref().map_or(inside, |voids| lanes.dense(voids) & inside);
            lanes.deposit(tables, walk, &sinks, if tables.scores_voids { inside } else { dense });
            hit = if tables.certain {
                lanes.accept_all();
                inside
            } else {
                lanes.accept(tables, dense)
            };
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
            let (one, two) = (words(tables.seed, index, 0, 0), words(tables.seed, index, 1, 0));
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
                self.weight[c][i] = weight[c] * task.scale;
            }
        }
        self.next += count as u64;
        self.left = count;
    }

    /// Starts the next photon at its light.
    #[inline(always)]
    fn enter(&mut self, tables: &Laned<C>, task: &Task, energies: &mut Energies) {
        let index = split(task.first + self.next);
        let weight: [f32; C] = std::array::from_fn(|c| task.emitter.colour[c] * task.scale);
        let (draws, start) = task.start(tables.seed, self.next);
        self.next += 1;
        let Start::Flight { p, direction } = start else { return energies.add(Share::Missed, weight) };
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
}

impl<'w> Sinks<'w> {
    fn new<const C: usize>(tables: &Laned<C>, walk: &'w Walk, task: &Task) -> Self {
        let first = if task.emitter.tallies_unscattered { tables.routes[0] } else { (None, None) };
        let routes = [first, tables.routes[1], tables.routes[2]];
        let set = walk.set();
        let bins = |layer: Option<usize>| layer.map(|l| &walk.bins[l][set]);
        Sinks { plain: routes.map(|r| bins(r.0)), angular: routes.map(|r| bins(r.1)) }
    }
}

/// The set bits of a mask.
#[inline(always)]
fn bits(mut mask: u32) -> impl Iterator<Item = usize> {
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
fn mask(flag: impl Fn(usize) -> bool) -> u32 {
    let mut mask = 0;
    for i in 0..N {
        mask |= u32::from(flag(i)) << i;
    }
    mask
}

impl<const C: usize> Lanes<C> {
    fn new(tables: &Laned<C>) -> Self {
        Lanes {
            last: tables.last,
            p: [[0.5; N]; 3],
            d: [[0.0; N], [0.0; N], [1.0; N]],
            weight: [[0.0; N]; C],
            absorbed: [[0.0; N]; C],
            order: [0; N],
            index: [[0; N]; 2],
            block: [0; N],
            word: [[0; N]; 4],
            xi: [0.5; N],
            depth: [0.0; N],
            at: [[0; N]; 3],
            majorant: [1.0; N],
            free_path: [tables.free_path; N],
            q: [[0.5; N]; 3],
            voxel: [[0; N]; 2],
            cell: [0; N],
            score: [[0.0; N]; C],
            density: [0.0; N],
        }
    }

    /// Puts the next photon into a lane.
    #[inline(always)]
    fn sow(&mut self, lane: usize, seeds: &mut Seeds<C>) {
        seeds.left -= 1;
        let seed = seeds.left;
        for a in 0..3 {
            self.p[a][lane] = seeds.p[a][seed];
            self.d[a][lane] = seeds.d[a][seed];
        }
        for c in 0..C {
            self.weight[c][lane] = seeds.weight[c][seed];
            self.absorbed[c][lane] = 0.0;
        }
        for k in 0..4 {
            self.word[k][lane] = seeds.word[k][seed];
        }
        self.xi[lane] = uniform(seeds.word[2][seed]);
        (self.index[0][lane], self.index[1][lane]) = (seeds.index[0][seed], seeds.index[1][seed]);
        self.block[lane] = seeds.block[seed];
        self.order[lane] = 0;
    }

    /// Absorbs and scatters in the lanes of `hit`; gives those whose fate must be decided.
    #[inline(always)]
    fn collide(&mut self, tables: &Laned<C>, hit: u32) -> u32 {
        let last = tables.last;
        let unlimited = last == u32::MAX;
        let mut albedo = [[0.0f32; N]; C];
        for c in 0..C {
            albedo[c] = [tables.medium.constant[c]; N];
        }
        if let Some(field) = &tables.medium.field {
            for lane in bits(hit) {
                let p = std::array::from_fn(|a| self.p[a][lane]);
                let word = words(tables.seed, [self.index[0][lane], self.index[1][lane]], self.block[lane], 1)[0];
                let value = field.one_read(p, word);
                for c in 0..C {
                    albedo[c][lane] = value;
                }
            }
        }
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
        if tables.isotropic {
            for i in 0..N {
                let d = sphere(self.xi[i], azimuth(self.word[3][i]));
                for a in 0..3 {
                    self.d[a][i] = if hit >> i & 1 == 1 { d[a] } else { self.d[a][i] };
                }
            }
        } else {
            let (cos_theta, sin_theta) = tables.phase.sample_lanes(&self.xi);
            for i in 0..N {
                let before = [self.d[0][i], self.d[1][i], self.d[2][i]];
                let d = rotate(before, cos_theta[i], sin_theta[i], azimuth(self.word[3][i]));
                for a in 0..3 {
                    self.d[a][i] = if hit >> i & 1 == 1 { d[a] } else { before[a] };
                }
            }
        }
        mask(|i| ends[i])
    }

    /// Ends the photon of a lane, or plays roulette; true if it is dead.
    #[inline(always)]
    fn decide(&mut self, lane: usize, tables: &Laned<C>, energies: &mut Energies) -> bool {
        let after: [f32; C] = std::array::from_fn(|c| self.weight[c][lane]);
        let top = after.iter().fold(0.0, |m: f32, &x| m.max(x));
        let dead = if top <= 0.0 {
            true
        } else if self.order[lane] > tables.last {
            energies.add(Share::Truncated, after);
            true
        } else if self.word[1][lane] >> 30 != 0 {
            energies.add(Share::Roulette, after);
            true
        } else {
            for c in 0..C {
                self.weight[c][lane] *= 1.0 / SURVIVAL;
            }
            energies.add::<C>(Share::Roulette, std::array::from_fn(|c| after[c] - self.weight[c][lane]));
            false
        };
        if dead {
            energies.add::<C>(Share::Absorbed, std::array::from_fn(|c| self.absorbed[c][lane]));
        }
        dead
    }

    /// The next four words of some lanes, and the free flight that they begin with.
    #[inline(always)]
    fn draw(&mut self, seed: [u32; 2], which: u32) {
        for i in 0..N {
            let takes = which >> i & 1 == 1;
            let word = words(seed, [self.index[0][i], self.index[1][i]], self.block[i], 0);
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
    fn fly(&mut self, tables: &Laned<C>) -> u32 {
        let n = tables.field.n();
        let mut inside = [false; N];
        for i in 0..N {
            let length = self.depth[i] * tables.free_path;
            let mut within = true;
            for a in 0..3 {
                let q = self.p[a][i] + self.d[a][i] * tables.medium.inverse_h[a] * length;
                self.q[a][i] = q;
                within &= q >= 0.0 && q < n[a] as f32;
            }
            inside[i] = within;
        }
        mask(|i| inside[i])
    }

    /// Moves the lanes `alive` on through the cells of majorants, until few of them are still `flying`; gives those at a
    /// tentative collision.
    #[inline(always)]
    fn cross(&mut self, tables: &Laned<C>, cells: &Cells, alive: u32, flying: &mut u32) -> u32 {
        let n = tables.field.n();
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
                    v[a] = self.d[a][i] * tables.medium.inverse_h[a];
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

    /// Lets the photon of a lane out of the box.
    #[inline(always)]
    fn escape(&mut self, lane: usize, tables: &Laned<C>, energies: &mut Energies) {
        let p: V3 = std::array::from_fn(|a| self.p[a][lane]);
        let v: V3 = std::array::from_fn(|a| self.d[a][lane] * tables.medium.inverse_h[a]);
        let (axis, _) = leave(p, v, tables.field.n());
        let face = 2 * axis + usize::from(v[axis] > 0.0);
        let share = if self.order[lane] == 0 { Share::Unscattered } else { EXIT_FACES[face] };
        energies.add::<C>(share, std::array::from_fn(|c| self.weight[c][lane]));
        energies.add::<C>(Share::Absorbed, std::array::from_fn(|c| self.absorbed[c][lane]));
    }

    /// Finds the voxels of the tentative collisions.
    #[inline(always)]
    fn locate(&mut self, tables: &Laned<C>) {
        let n = tables.field.n();
        for i in 0..N {
            let c = [0, 1, 2].map(|a| cell(self.q[a][i]) as u32);
            self.voxel[0][i] = flat(c, [n[0] as u32, n[1] as u32]);
        }
    }

    /// The lanes whose tentative collisions are not in a void.
    #[inline(always)]
    fn dense(&mut self, voids: &Voids) -> u32 {
        for i in 0..N {
            self.cell[i] = flat([0, 1, 2].map(|a| cell(self.q[a][i]) as u32 >> voids.shift), voids.n);
        }
        mask(|i| voids.empty.get(self.cell[i] as usize) == Some(&false))
    }

    /// Scores the tentative collisions of some lanes.
    #[inline(always)]
    fn deposit(&mut self, tables: &Laned<C>, walk: &Walk, sinks: &Sinks, scored: u32) {
        for i in 0..N {
            let unit = walk.unit * self.free_path[i];
            for c in 0..C {
                self.score[c][i] = self.weight[c][i] * unit;
            }
        }
        if let Some(order) = tables.harmonics {
            self.add_harmonics(order, &sinks.angular, scored);
        } else if sinks.angular.iter().any(Option::is_some) {
            let mut cos_theta = [0.0; N];
            for i in 0..N {
                let to_eye = tables.medium.eye.from([self.q[0][i], self.q[1][i], self.q[2][i]], tables.medium.h);
                let cosine = to_eye[0] * self.d[0][i] + to_eye[1] * self.d[1][i] + to_eye[2] * self.d[2][i];
                cos_theta[i] = Real::max(Real::min(cosine, 1.0), -1.0);
            }
            let toward_eye = tables.phase.pdf_lanes(&cos_theta);
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

    /// Adds the spherical harmonics of the direction of flight to the bins of each lane's voxel, times its score.
    #[inline(always)]
    fn add_harmonics(&self, order: usize, sinks: &[Option<&Bins>; 3], scored: u32) {
        let k = count(order);
        let mut y = [0.0f32; count(MAX_ORDER)];
        for lane in bits(scored) {
            let Some(bins) = sinks[self.slot(lane)] else { continue };
            evaluate([self.d[0][lane], self.d[1][lane], self.d[2][lane]], order, &mut y[..k]);
            let xi = rounding(self.word[3][lane]);
            let first = self.voxel[0][lane] as usize * k * C;
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
        for c in 0..C {
            let mut units = [0.0f32; N];
            let mut whole = [0i32; N];
            let mut large = false;
            for i in 0..N {
                units[i] = value[c][i] + rounding(self.word[3][i]);
                whole[i] = units[i] as i32;
                large |= units[i] >= 2_147_483_648.0;
            }
            if large {
                for lane in bits(scored) {
                    if let Some(bins) = sinks[self.slot(lane)] {
                        bins.add(self.voxel[0][lane] as usize * C + c, units[lane], 0.0);
                    }
                }
                continue;
            }
            if let Some(bins) = sinks[1] {
                for lane in bits(scored & !outer) {
                    bins.add_word(self.voxel[0][lane] as usize * C + c, whole[lane]);
                }
            }
            for lane in bits(outer) {
                if let Some(bins) = sinks[self.slot(lane)] {
                    bins.add_word(self.voxel[0][lane] as usize * C + c, whole[lane]);
                }
            }
        }
    }

    /// Makes every tentative collision real.
    #[inline(always)]
    fn accept_all(&mut self) {
        self.p = self.q;
        for i in 0..N {
            self.xi[i] = uniform(self.word[2][i]);
        }
    }

    /// Moves all lanes to their tentative collisions; gives those of `dense` where it is real.
    #[inline(always)]
    fn accept(&mut self, tables: &Laned<C>, dense: u32) -> u32 {
        let n = tables.field.n();
        self.p = self.q;
        let spread = if tables.field.linear() { 1.0f32 } else { 0.0 };
        for i in 0..N {
            let word = self.word[1][i];
            let c: [u32; 3] = std::array::from_fn(|a| {
                let q = Real::max(self.q[a][i] + spread * jitter(word, a), 0.0);
                cell(Real::min(q, n[a] as f32 - 0.5)) as u32
            });
            self.voxel[1][i] = flat(c, [n[0] as u32, n[1] as u32]);
        }
        let values = tables.field.values();
        self.density = [0.0; N];
        for lane in bits(dense) {
            self.density[lane] = values[self.voxel[1][lane] as usize];
        }
        let mut hit = [false; N];
        for i in 0..N {
            let accept = self.density[i] * tables.extinction * self.free_path[i];
            let xi = uniform(self.word[2][i]);
            hit[i] = xi <= accept;
            self.xi[i] = Real::min(xi / accept, 1.0);
        }
        mask(|i| hit[i]) & dense
    }
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

/// What rounds a deposit, from the lower ten bits.
#[inline(always)]
fn rounding(word: u32) -> f32 {
    (word & 1023) as f32 * (1.0 / 1024.0) + 0.5 / 1024.0
}

/// A part of a turn from the upper 22 bits.
#[inline(always)]
fn azimuth(word: u32) -> f32 {
    (word >> 10) as f32 * (1.0 / 4_194_304.0)
}
