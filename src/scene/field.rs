//! The density along a line. Positions are in voxel coordinates (0 to n per axis); velocities in voxels per unit of
//! world length, so that parameters along a line are lengths.

mod line;
mod occupancy;

pub use line::{Dda, V3, along, floor, leave, leave_ball};
pub use occupancy::{BLOCK, Occupancy};

use super::Volume;

/// Eight corner values of a cell of trilinear interpolation: those at its lower x face, and at its upper.
#[derive(Debug, Clone, Copy)]
pub struct Corners([[f32; 4]; 2]);

impl Corners {
    /// The interpolated value at `u`, each within [0, 1].
    #[inline(always)]
    pub fn at(&self, u: V3) -> f32 {
        let (low, high) = (&self.0[0], &self.0[1]);
        let mut x = [0.0; 4];
        for i in 0..4 {
            x[i] = low[i] + u[0] * (high[i] - low[i]);
        }
        let y0 = x[0] + u[1] * (x[1] - x[0]);
        let y1 = x[2] + u[1] * (x[3] - x[2]);
        y0 + u[2] * (y1 - y0)
    }

    /// Whether all values are zero.
    #[inline(always)]
    pub fn is_zero(&self) -> bool {
        self.0.as_flattened().iter().all(|&value| value == 0.0)
    }

    /// The interpolated value along `u + s w` as the coefficients of a cubic in `s`.
    #[inline]
    pub fn cubic(&self, u: [f64; 3], w: [f64; 3]) -> [f64; 4] {
        let x: [[f64; 2]; 4] = std::array::from_fn(|i| {
            let (low, rise) = (f64::from(self.0[0][i]), f64::from(self.0[1][i]) - f64::from(self.0[0][i]));
            [low + u[0] * rise, w[0] * rise]
        });
        let y = |a: [f64; 2], b: [f64; 2]| {
            let rise = [b[0] - a[0], b[1] - a[1]];
            [a[0] + u[1] * rise[0], a[1] + u[1] * rise[1] + w[1] * rise[0], w[1] * rise[1]]
        };
        let (low, high) = (y(x[0], x[1]), y(x[2], x[3]));
        let rise: [f64; 3] = std::array::from_fn(|i| high[i] - low[i]);
        [
            low[0] + u[2] * rise[0],
            low[1] + u[2] * rise[1] + w[2] * rise[0],
            low[2] + u[2] * rise[2] + w[2] * rise[1],
            w[2] * rise[2],
        ]
    }
}

/// Up to half a voxel either way along an axis, from ten bits of a word each: what [`Field::one_read`] moves a point by.
#[inline(always)]
pub fn jitter(word: u32, axis: usize) -> f32 {
    (word >> (10 * axis) & 1023) as f32 * (1.0 / 1024.0) - (511.5 / 1024.0)
}

/// The two indices and the weight of linear interpolation between voxel centres along one axis; beyond the outermost
/// centres the line through the last two goes on.
#[inline(always)]
pub fn between(p: f32, n: i32) -> (usize, usize, f32) {
    let q = p - 0.5;
    let i = floor(q).min(n - 2).max(0);
    (i as usize, (i + 1).min(n - 1) as usize, q - i as f32)
}

/// A scalar per voxel, constant or linear between voxel centres.
#[derive(Debug, Clone, Copy)]
pub struct Field<'a> {
    values: &'a [f32],
    n: [i32; 3],
    linear: bool,
    constant: bool,
    ball: bool,
    occupancy: Option<&'a Occupancy>,
}

impl<'a> Field<'a> {
    /// The volume's densities.
    pub fn density(volume: &Volume<'a>) -> Self {
        Field { constant: volume.is_constant(), ..Field::new(volume.density(), volume) }
    }

    /// Other values on the voxels of a volume.
    pub fn new(values: &'a [f32], volume: &Volume) -> Self {
        Field {
            values,
            n: volume.n().map(|m| m as i32),
            linear: volume.linear(),
            constant: false,
            ball: volume.is_ball(),
            occupancy: None,
        }
    }

    /// The same field, walked past its empty blocks.
    pub fn skipping(self, occupancy: Option<&'a Occupancy>) -> Self {
        Field { occupancy, ..self }
    }

    /// Voxels along x, y, z.
    #[inline(always)]
    pub fn n(&self) -> [i32; 3] {
        self.n
    }

    /// All values, x fastest.
    #[inline(always)]
    pub fn values(&self) -> &'a [f32] {
        self.values
    }

    /// Where a line from within leaves the medium: the axis of the box's face (0 for a ball), and the parameter.
    #[inline(always)]
    pub fn leave(&self, p: V3, v: V3) -> (usize, f32) {
        if self.ball { (0, leave_ball(p, v)) } else { leave(p, v, self.n) }
    }

    /// Whether the medium fills a ball, not the box.
    #[inline(always)]
    pub fn is_ball(&self) -> bool {
        self.ball
    }

    /// The value everywhere, where it is known to be constant.
    #[inline(always)]
    pub fn constant(&self) -> Option<f32> {
        self.constant.then(|| self.values[0])
    }

    /// The mean over a voxel: its own value, or with interpolation the exact mean of the trilinear function, which is
    /// (1/8, 6/8, 1/8) along each axis.
    pub fn voxel_mean(&self, voxel: [usize; 3]) -> f32 {
        let n = self.n;
        if !self.linear {
            return self.voxel(voxel.map(|c| c as i32));
        }
        let mut sum = 0.0;
        for (dz, wz) in [(-1, 0.125f32), (0, 0.75), (1, 0.125)] {
            for (dy, wy) in [(-1, 0.125f32), (0, 0.75), (1, 0.125)] {
                let y = (voxel[1] as i32 + dy).clamp(0, n[1] - 1);
                let z = (voxel[2] as i32 + dz).clamp(0, n[2] - 1);
                let x = voxel[0] as i32;
                let (left, right) = ((x - 1).max(0), (x + 1).min(n[0] - 1));
                let line =
                    0.125 * (self.voxel([left, y, z]) + self.voxel([right, y, z])) + 0.75 * self.voxel([x, y, z]);
                sum += wy * wz * line;
            }
        }
        sum
    }

    /// Whether values are interpolated.
    #[inline(always)]
    pub fn linear(&self) -> bool {
        self.linear
    }

    /// The index of voxel (i, j, k).
    #[inline(always)]
    pub fn index(&self, c: [i32; 3]) -> usize {
        ((c[2] * self.n[1] + c[1]) as usize) * self.n[0] as usize + c[0] as usize
    }

    /// Whether the field may be other than zero in a voxel.
    #[inline(always)]
    pub fn occupied(&self, voxel: [usize; 3]) -> bool {
        self.occupancy.is_none_or(|occupancy| occupancy.voxel(voxel))
    }

    /// The value of voxel (i, j, k), which must lie on the grid.
    #[inline(always)]
    pub fn voxel(&self, c: [i32; 3]) -> f32 {
        self.values[self.index(c)]
    }

    /// The values from voxel (i, j, k) on, x fastest.
    #[inline(always)]
    pub fn from(&self, c: [i32; 3]) -> &'a [f32] {
        &self.values[self.index(c)..]
    }

    /// The cell of interpolation (i, j, k), from -1 to n - 1.
    #[inline(always)]
    pub fn corners(&self, c: [i32; 3]) -> Corners {
        let n = self.n;
        let low = |a: usize| c[a].max(0) as usize;
        let high = |a: usize| (c[a] + 1).min(n[a] - 1) as usize;
        let (row, slice) = (n[0] as usize, (n[0] * n[1]) as usize);
        let (x0, x1) = (low(0), high(0));
        let (y0, y1) = (low(1) * row, high(1) * row);
        let (z0, z1) = (low(2) * slice, high(2) * slice);
        let v = self.values;
        let rows = [z0 + y0, z0 + y1, z1 + y0, z1 + y1];
        Corners([rows.map(|r| v[r + x0]), rows.map(|r| v[r + x1])])
    }

    /// The value at a point.
    #[inline(always)]
    pub fn at(&self, p: V3) -> f32 {
        if self.linear {
            let q = p.map(|c| c - 0.5);
            let cell: [i32; 3] = std::array::from_fn(|a| floor(q[a]).clamp(-1, self.n[a] - 1));
            self.corners(cell).at(std::array::from_fn(|a| (q[a] - cell[a] as f32).clamp(0.0, 1.0)))
        } else {
            self.voxel(std::array::from_fn(|a| (p[a] as i32).clamp(0, self.n[a] - 1)))
        }
    }

    /// A value whose mean over `word` is the value at the point, from one read: the point is jittered by up to half a
    /// voxel, and the voxel there taken (box filtering of the nearest value is linear interpolation).
    #[inline(always)]
    pub fn one_read(&self, p: V3, word: u32) -> f32 {
        if !self.linear {
            return self.at(p);
        }
        let c: [i32; 3] = std::array::from_fn(|a| {
            let q = p[a] + jitter(word, a);
            (q.max(0.0) as i32).min(self.n[a] - 1)
        });
        self.voxel(c)
    }

    /// The integral of the field along `p + t v` for t from 0 to `end`, exact: the field is cubic within a cell of
    /// interpolation, and two Gauss points integrate cubics exactly.
    #[inline]
    pub fn column(&self, p: V3, v: V3, end: f32) -> f32 {
        self.column_up_to(p, v, end, f32::INFINITY)
    }

    /// The same, but no further than where it exceeds `enough`.
    #[inline]
    pub fn column_up_to(&self, p: V3, v: V3, end: f32, enough: f32) -> f32 {
        if let Some(density) = self.constant() {
            return density * end.min(self.leave(p, v).1);
        }
        let mut sum = 0.0f32;
        if self.linear {
            self.visit(p, v, end, |cell, t0, t1| {
                sum += self.linear_piece(cell, p, v, t0, t1);
                sum <= enough
            });
        } else {
            self.visit(p, v, end, |cell, t0, t1| {
                sum += self.voxel(cell) * (t1 - t0);
                sum <= enough
            });
        }
        sum
    }

    /// The integral over a piece that [`Field::visit`] gives.
    #[inline(always)]
    pub fn piece(&self, cell: [i32; 3], p: V3, v: V3, t0: f32, t1: f32) -> f32 {
        if self.linear { self.linear_piece(cell, p, v, t0, t1) } else { self.voxel(cell) * (t1 - t0) }
    }

    #[inline(always)]
    fn linear_piece(&self, cell: [i32; 3], p: V3, v: V3, t0: f32, t1: f32) -> f32 {
        const NODE: f32 = 0.211_324_87;
        let corners = self.corners(cell);
        let step = NODE * (t1 - t0);
        let base: V3 = std::array::from_fn(|a| p[a] - (cell[a] as f32 + 0.5));
        let value = |t: f32| corners.at(along(base, v, t));
        0.5 * (t1 - t0) * (value(t0 + step) + value(t1 - step))
    }

    /// Calls `f(cell, t0, t1)` for the pieces of `p + t v`, t from 0 to `end`, within which the field is one polynomial,
    /// front to back and past empty blocks, until it returns false. The cells are voxels, or with interpolation the cells
    /// between voxel centres.
    #[inline(always)]
    pub fn visit(&self, p: V3, v: V3, end: f32, mut f: impl FnMut([i32; 3], f32, f32) -> bool) {
        self.runs(p, v, end, |t0, t1| self.visit_cells(p, v, t0, t1, &mut f));
    }

    /// Calls `f(t0, t1)` for the runs of blocks along `p + t v`, t from 0 to `end`, that are not empty, front to back, until
    /// it returns false.
    #[inline(always)]
    pub fn runs(&self, p: V3, v: V3, end: f32, mut f: impl FnMut(f32, f32) -> bool) {
        // Cells between voxel centres reach over the box's faces, the medium does not.
        let end = end.min(self.leave(p, v).1);
        let Some(occupancy) = self.occupancy else {
            f(0.0, end);
            return;
        };
        const SCALE: f32 = 1.0 / BLOCK as f32;
        let mut blocks = Dda::new(p.map(|c| c * SCALE), v.map(|c| c * SCALE), [0; 3], occupancy.n);
        let (mut t, mut from) = (0.0f32, f32::INFINITY);
        loop {
            // Runs of occupied blocks are walked as one.
            let (axis, exit) = blocks.exit();
            let occupied = occupancy.at(blocks.cell);
            if occupied && from == f32::INFINITY {
                from = t;
            }
            if !occupied && from < t && !f(from, t) {
                return;
            }
            if !occupied {
                from = f32::INFINITY;
            }
            t = exit.min(end).max(t);
            if exit >= end || !blocks.advance(axis) {
                if from < t {
                    f(from, t);
                }
                return;
            }
        }
    }

    /// The pieces from t0 to t1; false if `f` stopped it.
    #[inline(always)]
    fn visit_cells(&self, p: V3, v: V3, t0: f32, t1: f32, f: &mut impl FnMut([i32; 3], f32, f32) -> bool) -> bool {
        let mut cells = self.cells(along(p, v, t0), v);
        let (mut t, end) = (t0, t1 - t0);
        loop {
            let (axis, exit) = cells.exit();
            let stop = t0 + exit.min(end);
            if stop > t {
                if !f(cells.cell, t, stop) {
                    return false;
                }
                t = stop;
            }
            if exit >= end || !cells.advance(axis) {
                return true;
            }
        }
    }

    /// The walk over the cells within which the field is one polynomial: voxels, or cells between voxel centres.
    #[inline(always)]
    fn cells(&self, p: V3, v: V3) -> Dda {
        if self.linear { Dda::new(p.map(|c| c - 0.5), v, [-1; 3], self.n) } else { Dda::new(p, v, [0; 3], self.n) }
    }

    /// The parameter within [t0, t1] at which the integral from t0 reaches `target`, in a cell of interpolation that holds
    /// the line between them: Newton's method kept within its bracket.
    pub fn invert(&self, corners: &Corners, cell: [i32; 3], p: V3, v: V3, (t0, t1): (f32, f32), target: f32) -> f32 {
        let value = |t: f32| corners.at(local(along(p, v, t), cell));
        let start = value(t0);
        let (mut low, mut high) = (t0, t1);
        let mut t = 0.5 * (t0 + t1);
        for _ in 0..24 {
            let here = value(t);
            let sum = (start + 4.0 * value(0.5 * (t0 + t)) + here) * ((t - t0) * (1.0 / 6.0)) - target;
            if sum > 0.0 {
                high = t
            } else {
                low = t
            }
            let newton = t - sum / here.max(1e-30);
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            if (next - t).abs() <= 1e-6 * (t1 - t0) {
                return next;
            }
            t = next;
        }
        t
    }
}

/// Coordinates within the cell of interpolation, kept within [0, 1].
#[inline(always)]
pub fn local(p: V3, cell: [i32; 3]) -> V3 {
    std::array::from_fn(|a| (p[a] - 0.5 - cell[a] as f32).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume(density: &[f32], linear: bool) -> Volume<'_> {
        Volume::new(density, [5, 4, 3], [0.5, 1.0, 2.0], [0.0; 3], linear).expect("valid")
    }

    fn noise() -> Vec<f32> {
        (0..60).map(|i| ((i * 7919 + 13) % 101) as f32 / 100.0).collect()
    }

    /// A line between two faces, and its length.
    fn lines() -> Vec<(V3, V3, f32)> {
        vec![
            ([0.0, 1.3, 0.2], [2.0, 0.3, 0.1], 2.5),
            ([5.0, 3.9, 2.9], [-1.7, -1.3, -0.9], 2.9),
            ([2.5, 0.0, 1.5], [0.0, 1.0, 0.0], 4.0),
            ([1.2, 2.3, 0.0], [1e-7, -1e-7, 0.5], 6.0),
        ]
    }

    #[test]
    fn column_agrees_with_a_fine_sum() {
        let data = noise();
        for linear in [false, true] {
            let v = volume(&data, linear);
            let field = Field::density(&v);
            for (p, d, end) in lines() {
                let m = 200_000;
                let fine: f64 =
                    (0..m).map(|i| f64::from(field.at(along(p, d, (i as f32 + 0.5) / m as f32 * end)))).sum::<f64>()
                        * f64::from(end)
                        / f64::from(m);
                let got = f64::from(field.column(p, d, end));
                assert!((got - fine).abs() < 2e-4 * fine.max(1.0), "linear {linear} {p:?}: {got} vs {fine}");
            }
        }
    }

    #[test]
    fn skipping_empty_blocks_changes_nothing() {
        let n = [40usize, 25, 33];
        let mut data = vec![0.0f32; n[0] * n[1] * n[2]];
        for (at, d) in data.iter_mut().enumerate() {
            let (i, j, k) = (at % n[0], at / n[0] % n[1], at / (n[0] * n[1]));
            if (i / 5 + j / 7 + k / 9) % 5 == 0 {
                *d = ((at * 7919) % 101) as f32 / 100.0;
            }
        }
        for linear in [false, true] {
            let v = Volume::new(&data, n, [1.0; 3], [0.0; 3], linear).expect("valid");
            let whole = Field::density(&v);
            let occupancy = Occupancy {
                n: n.map(|m| m.div_ceil(BLOCK) as i32),
                occupied: super::super::block_maxima(&v, BLOCK, v.reach()).iter().map(|&d| d > 0.0).collect(),
            };
            let skipping = whole.skipping(Some(&occupancy));
            for i in 0..500 {
                let f = |k: usize| ((i * 7919 + k * 104_729) % 1009) as f32 / 1009.0;
                let p = [f(1) * 40.0, f(2) * 25.0, f(3) * 33.0];
                let d = [f(4) - 0.5, f(5) - 0.5, f(6) - 0.5];
                let (a, b) = (whole.column(p, d, 60.0), skipping.column(p, d, 60.0));
                assert!((a - b).abs() <= 1e-4 * a.max(1.0), "{p:?} {d:?}: {a} vs {b}");
            }
        }
    }

    #[test]
    fn one_read_has_the_interpolated_value_as_its_mean() {
        let data = noise();
        let v = volume(&data, true);
        let field = Field::density(&v);
        for p in [[0.1f32, 0.2, 0.3], [2.7, 1.9, 1.4], [4.95, 3.5, 2.99]] {
            let m = 400_000u32;
            let mean: f64 =
                (0..m).map(|i| f64::from(field.one_read(p, i.wrapping_mul(2_654_435_769) >> 2))).sum::<f64>()
                    / f64::from(m);
            assert!((mean - f64::from(field.at(p))).abs() < 3e-3, "{p:?}: {mean} vs {}", field.at(p));
        }
    }

    #[test]
    fn dda_ends_on_every_line() {
        let data = noise();
        let v = volume(&data, true);
        let field = Field::density(&v);
        for i in 0..10_000u32 {
            let r = |k: u32| {
                ((i.wrapping_mul(747_796_405).wrapping_add(k.wrapping_mul(2_891_336_453))) >> 8) as f32 / 1.7e7
            };
            let p = [5.0 * r(1), 4.0 * r(2), 3.0 * r(3)];
            let d = [r(4) - 0.5, r(5) - 0.5, if i % 7 == 0 { 0.0 } else { r(6) - 0.5 }];
            let mut steps = 0;
            field.visit(p, d, f32::INFINITY, |_, _, _| {
                steps += 1;
                steps < 20
            });
            assert!(steps < 20);
        }
    }
}
