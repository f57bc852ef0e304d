//! Equirectangular maps of the radiance that comes from the sky.
//!
//! A direction d points to the sky; light travels against it. With z up, rows go down from +z: the polar angle is
//! theta = pi y / height; columns go to the right of a viewer: x / width = 1/2 + atan2(d_x, d_y) / (2 pi), so that the
//! middle column looks along +y and the one a quarter to its right along +x. Row and column centres are at y, x = 1/2,
//! 3/2, ...

mod shower;
mod table;

pub use shower::{Shower, per_mean, weights};

use crate::error::{Result, scene_error};
use crate::physics::Real;
use rayon::prelude::*;
use std::f64::consts::PI;
use table::Table;

/// Most texels along an axis.
const LARGEST: usize = 65_536;
/// A texel that is not dark is drawn with this part of the brightest one's importance at least.
const LEAST_IMPORTANCE: f64 = 1e-9;

/// A map of radiance [W/(area sr)], bilinear between texel centres, wrapped in azimuth and clamped at the poles.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    texels: Vec<f32>,
    width: usize,
    height: usize,
    channels: usize,
    /// Cosine of the polar angle at the upper edge of each row, and at the lower edge of the last.
    cosines: Vec<f64>,
    importance: Table,
}

impl Map {
    /// A map from its texels, row by row from +z down, `channels` (1 or 3) values each: finite, not negative (up to 1e30). The error
    /// counts the bad ones and names the first by [row, column] or [row, column, channel].
    pub fn new(texels: Vec<f32>, width: usize, height: usize, channels: usize) -> Result<Self> {
        let name = "EnvironmentLight: radiance";
        if !matches!(channels, 1 | 3) || [width, height].iter().any(|&m| m == 0 || m > LARGEST) {
            return scene_error(format!(
                "{name} is a map of {height} x {width} texels of {channels} channels; 1 to {LARGEST} rows and columns of 1 \
                 or 3 (RGB) channels are allowed"
            ));
        }
        if texels.len() != width * height * channels {
            return scene_error(format!("{name} has {} values for {height} x {width} texels", texels.len()));
        }
        let bad = |v: &&f32| !(**v >= 0.0 && **v <= 1e30);
        if let Some(first) = texels.par_iter().position_first(|v| bad(&v)) {
            let (texel, channel) = (first / channels, first % channels);
            let mut index = format!("{}, {}", texel / width, texel % width);
            if channels > 1 {
                index = format!("{index}, {channel}");
            }
            return scene_error(format!(
                "{name}: {} values of the map are not finite numbers from 0 to 1e30, the first at index [{index}]: {}",
                texels.iter().filter(bad).count(),
                texels[first]
            ));
        }
        let cosines = (0..=height).map(|row| (PI * row as f64 / height as f64).cos()).collect();
        let mut map = Map { texels, width, height, channels, cosines, importance: Table::default() };
        let top = f64::from(map.texels.par_iter().copied().reduce(|| 0.0, f32::max));
        let importance = |row: usize, column: usize| {
            let mean = map.mean(row, column);
            if mean > 0.0 { mean.max(LEAST_IMPORTANCE * top) * map.solid_angle(row) } else { 0.0 }
        };
        map.importance = Table::new(width, height, importance);
        Ok(map)
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// 1 or 3.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// All values, row by row from +z down, channels fastest.
    pub fn texels(&self) -> &[f32] {
        &self.texels
    }

    /// The importance that directions are drawn by, as [`Table::ends`].
    pub fn importance(&self) -> [Vec<u32>; 2] {
        self.importance.ends()
    }

    /// The largest value of each channel.
    pub fn max(&self) -> [f64; 3] {
        let top =
            |channel: usize| self.texels.iter().skip(channel).step_by(self.channels).fold(0.0f32, |m, &v| m.max(v));
        let each: Vec<f64> = (0..self.channels).map(|c| f64::from(top(c))).collect();
        std::array::from_fn(|c| each[c % self.channels])
    }

    /// The radiance of every direction, if all texels are equal.
    pub fn constant(&self) -> Option<&[f32]> {
        let first = &self.texels[..self.channels];
        self.texels.chunks(self.channels).all(|texel| texel == first).then_some(first)
    }

    /// The radiance from the direction `d`, a unit vector to the sky.
    #[inline]
    pub fn radiance(&self, d: [f32; 3]) -> [f32; 3] {
        let [x, y] = self.place(d);
        self.at(x, y)
    }

    /// A direction to the sky and its density per steradian, from two uniform numbers within [0, 1]: a texel by its mean
    /// radiance (of the brightest channel) times its solid angle, and a direction uniform over it.
    #[inline]
    pub fn sample(&self, u: f32, v: f32) -> ([f32; 3], f32) {
        let (row, y) = self.importance.row(f64::from(u));
        let (column, x) = self.importance.column(row, f64::from(v));
        (self.direction(row, column, x, y).0.map(|c| c as f32), self.density(row, column))
    }

    /// The density per steradian with which [`Map::sample`] draws the direction `d`.
    #[inline]
    pub fn pdf(&self, d: [f32; 3]) -> f32 {
        let [x, y] = self.place(d);
        self.density((y as usize).min(self.height - 1), (x as usize).min(self.width - 1))
    }

    /// The integral over all directions of radiance times the projected area of a box of the given size [W], by channel:
    /// the power that the sky sends into it. Exact but for rounding: the hat of a texel is a product of two, and so is
    /// each term of the projected area.
    pub fn projected(&self, size: [f64; 3]) -> [f64; 3] {
        let [top, wide] = [PI / self.height as f64, 2.0 * PI / self.width as f64];
        let mut upward = vec![0.0; self.height];
        let mut sideways = vec![0.0; self.height];
        let mut add = |low: Option<usize>, high: Option<usize>, from: f64, to: f64| {
            let (up, side) =
                (linear_moments(from, to, |t| t.cos().abs() * t.sin()), linear_moments(from, to, |t| t.sin().powi(2)));
            let rows = [low.or(high), high.or(low)];
            for (row, end) in rows.into_iter().zip([0, 1]) {
                if let Some(row) = row {
                    upward[row] += up[end];
                    sideways[row] += side[end];
                }
            }
        };
        add(None, Some(0), 0.0, 0.5 * top);
        for row in 1..self.height {
            add(Some(row - 1), Some(row), (row as f64 - 0.5) * top, (row as f64 + 0.5) * top);
        }
        add(Some(self.height - 1), None, PI - 0.5 * top, PI);
        let (mut along_x, mut along_y) = (vec![0.0; self.width], vec![0.0; self.width]);
        for column in 0..self.width {
            let from = (column as f64 + 0.5) * wide - PI;
            let (x, y) = (
                linear_moments(from, from + wide, |t| t.sin().abs()),
                linear_moments(from, from + wide, |t| t.cos().abs()),
            );
            for (column, end) in [column, (column + 1) % self.width].into_iter().zip([0, 1]) {
                along_x[column] += x[end];
                along_y[column] += y[end];
            }
        }
        let faces = faces(size);
        let across: Vec<f64> = along_x.iter().zip(&along_y).map(|(x, y)| faces[0] * x + faces[1] * y).collect();
        let mut sum = [0.0; 3];
        for (row, line) in self.texels.chunks(self.width * self.channels).enumerate() {
            for (column, texel) in line.chunks(self.channels).enumerate() {
                let weight = upward[row] * faces[2] * wide + sideways[row] * across[column];
                for (sum, &value) in sum.iter_mut().zip(texel) {
                    *sum += weight * f64::from(value);
                }
            }
        }
        std::array::from_fn(|c| sum[c % self.channels])
    }

    /// The texel coordinates of a direction: x within [0, width], y within [0, height].
    #[inline]
    fn place(&self, d: [f32; 3]) -> [f32; 2] {
        let turn = d[0].atan2(d[1]) * (0.5 * std::f32::consts::FRAC_1_PI) + 0.5;
        let polar = d[0].hypot(d[1]).atan2(d[2]) * std::f32::consts::FRAC_1_PI;
        [turn * self.width as f32, polar * self.height as f32]
    }

    /// The bilinear value at texel coordinates.
    #[inline]
    fn at(&self, x: f32, y: f32) -> [f32; 3] {
        let (x, y) = (x - 0.5, Real::min(Real::max(y - 0.5, 0.0), (self.height - 1) as f32));
        let (left, top) = (x.floor(), y.floor());
        let (u, v) = (x - left, y - top);
        // From -1 to width: wrapped.
        let left = (left as isize).rem_euclid(self.width as isize) as usize;
        let right = if left + 1 < self.width { left + 1 } else { 0 };
        let top = top as usize;
        let rows = [top, (top + 1).min(self.height - 1)];
        std::array::from_fn(|c| {
            let value = |row: usize, column: usize| {
                self.texels[(row * self.width + column) * self.channels + c % self.channels]
            };
            let line = |row: usize| value(row, left) + u * (value(row, right) - value(row, left));
            let [high, low] = rows.map(line);
            high + v * (low - high)
        })
    }

    /// Unit vector to the place (x, y), each within [0, 1], of a texel, uniform over it if they are; and its texel coordinate
    /// along y.
    #[inline]
    fn direction(&self, row: usize, column: usize, x: f64, y: f64) -> ([f64; 3], f64) {
        let (top, bottom) = (self.cosines[row], self.cosines[row + 1]);
        let cosine = top + y * (bottom - top);
        let sine = ((1.0 - cosine) * (1.0 + cosine)).max(0.0).sqrt();
        let (sin, cos) = (2.0 * PI * ((column as f64 + x) / self.width as f64 - 0.5)).sin_cos();
        ([sine * sin, sine * cos, cosine], sine.atan2(cosine) * self.height as f64 / PI)
    }

    /// Solid angle of each texel of a row.
    pub fn solid_angle(&self, row: usize) -> f64 {
        let half = 0.5 * PI / self.height as f64;
        let middle = PI * (row as f64 + 0.5) / self.height as f64;
        2.0 * PI / self.width as f64 * 2.0 * middle.sin() * half.sin()
    }

    /// Density per steradian of a texel's directions.
    #[inline]
    fn density(&self, row: usize, column: usize) -> f32 {
        let total = self.importance.total();
        if total > 0.0 { (self.importance.mass(row, column) / total / self.solid_angle(row)) as f32 } else { 0.0 }
    }

    /// The eight neighbours of a texel and itself, of a channel, row by row.
    fn around(&self, row: usize, column: usize, channel: usize) -> [[f64; 3]; 3] {
        let rows = [row.saturating_sub(1), row, (row + 1).min(self.height - 1)];
        let columns = [(column + self.width - 1) % self.width, column, (column + 1) % self.width];
        rows.map(|r| columns.map(|c| f64::from(self.texels[(r * self.width + c) * self.channels + channel])))
    }

    /// The mean of the bilinear function over a texel, of its brightest channel.
    fn mean(&self, row: usize, column: usize) -> f64 {
        let line = |v: [f64; 3]| 0.125 * (v[0] + v[2]) + 0.75 * v[1];
        (0..self.channels).map(|c| line(self.around(row, column, c).map(line))).fold(0.0, f64::max)
    }

    /// The most that the sum of all channels, each times its factor, reaches within a texel: at its centre, on its edges,
    /// or in its corners.
    fn most(&self, row: usize, column: usize, factors: &[f32; 3]) -> f64 {
        let mut sum = [[0.0; 3]; 3];
        for channel in 0..self.channels {
            let values = self.around(row, column, channel);
            let factor = f64::from(factors[channel]);
            sum.iter_mut().flatten().zip(values.iter().flatten()).for_each(|(sum, v)| *sum += factor * v);
        }
        let ends = |v: [f64; 3]| [0.5 * (v[0] + v[1]), v[1], 0.5 * (v[1] + v[2])];
        let lines = sum.map(ends);
        (0..3).flat_map(|c| ends([lines[0][c], lines[1][c], lines[2][c]])).fold(0.0, f64::max)
    }
}

/// The areas of a box's faces normal to x, y and z.
fn faces(size: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|a| size[(a + 1) % 3] * size[(a + 2) % 3])
}

/// The integrals over [from, to] of f times 1 - t and times t, t rising from 0 to 1; f may have kinks at multiples of
/// pi/2.
fn linear_moments(from: f64, to: f64, f: impl Fn(f64) -> f64) -> [f64; 2] {
    const PIECE: f64 = PI / 16.0;
    const NODES: [(f64, f64); 3] = [
        (0.112_701_665_379_258_3, 0.277_777_777_777_777_8),
        (0.5, 0.444_444_444_444_444_4),
        (0.887_298_334_620_741_7, 0.277_777_777_777_777_8),
    ];
    // All kinks are multiples of the piece.
    let mut cuts = vec![from];
    let first = (from / PIECE).floor() as i64 + 1;
    cuts.extend((first..).map(|k| k as f64 * PIECE).take_while(|&cut| cut < to).filter(|&cut| cut > from));
    cuts.push(to);
    let mut sum = [0.0; 2];
    for pair in cuts.windows(2) {
        for (x, w) in NODES {
            let at = pair[0] + x * (pair[1] - pair[0]);
            let t = (at - from) / (to - from);
            let value = w * (pair[1] - pair[0]) * f(at);
            sum[0] += value * (1.0 - t);
            sum[1] += value * t;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::rng::{Draws, uniform, uniform64};
    use crate::scene::light::projected_area;

    /// A map with dark parts, a sun and a gradient.
    fn sky(width: usize, height: usize, channels: usize) -> Map {
        let texels = (0..width * height * channels)
            .map(|i| if i % 5 == 3 { 0.0 } else { (((i + 1) * 7919) % 101) as f32 / 20.0 })
            .enumerate()
            .map(|(i, v)| if i == width * channels + 1 { 500.0 } else { v })
            .collect();
        Map::new(texels, width, height, channels).expect("valid")
    }

    /// A midpoint sum over all directions.
    fn over_sphere(n: usize, f: impl Fn([f32; 3]) -> f64) -> f64 {
        let mut sum = 0.0;
        for j in 0..n {
            let z = 1.0 - 2.0 * (j as f64 + 0.5) / n as f64;
            for i in 0..2 * n {
                let (sin, cos) = (PI * (i as f64 + 0.5) / n as f64).sin_cos();
                let s = (1.0 - z * z).sqrt();
                sum += f([s * sin, s * cos, z].map(|c| c as f32));
            }
        }
        sum * 4.0 * PI / (2 * n * n) as f64
    }

    #[test]
    fn directions_point_where_the_documentation_says() {
        let map = Map::new((0..32).map(|i| i as f32).collect(), 8, 4, 1).expect("valid");
        let near = |d: [f32; 3], truth: f32| {
            let value = map.radiance(d)[0];
            assert!((value - truth).abs() < 1e-4, "{d:?}: {value} and not {truth}");
        };
        // Between the rows 1 (8 to 15) and 2 (16 to 23) at the horizon; columns 3 and 4 are the middle.
        near([0.0, 1.0, 0.0], 0.25 * (11.0 + 12.0 + 19.0 + 20.0));
        near([1.0, 0.0, 0.0], 0.25 * (13.0 + 14.0 + 21.0 + 22.0));
        near([-1.0, 0.0, 0.0], 0.25 * (9.0 + 10.0 + 17.0 + 18.0));
        near([0.0, -1.0, 0.0], 0.25 * (8.0 + 15.0 + 16.0 + 23.0));
        near([1e-6, 1e-5, 1.0], 3.5 + (0.1f32).atan() * 4.0 * std::f32::consts::FRAC_1_PI);
        near([1e-6, 1e-5, -1.0], 27.5 + (0.1f32).atan() * 4.0 * std::f32::consts::FRAC_1_PI);
    }

    #[test]
    fn density_integrates_to_one_and_is_positive_where_there_is_light() {
        for (width, height, channels) in [(1, 1, 1), (2, 1, 3), (1, 2, 1), (7, 5, 1), (16, 9, 3)] {
            let map = sky(width, height, channels);
            let sum = over_sphere(1000, |d| f64::from(map.pdf(d)));
            assert!((sum - 1.0).abs() < 5e-3, "{width} x {height}: {sum}");
            over_sphere(100, |d| {
                assert!(map.pdf(d) > 0.0 || map.radiance(d).iter().all(|&v| v == 0.0));
                0.0
            });
        }
    }

    #[test]
    fn samples_follow_the_density() {
        let map = sky(12, 7, 3);
        let count = 400_000u64;
        let mut hits = vec![0.0f64; 12 * 7];
        for i in 0..count {
            let words = Draws::new([3, 1], i, 9).next4();
            let (d, pdf) = map.sample(uniform(words[0]), uniform(words[1]));
            let [x, y] = map.place(d);
            let (row, column) = ((y as usize).min(6), (x as usize).min(11));
            hits[row * 12 + column] += 1.0;
            let inside = |c: f32| (c - c.round()).abs() > 1e-3;
            assert!(!(inside(x) && inside(y)) || (pdf / map.pdf(d) - 1.0).abs() < 1e-4);
            assert!((d.iter().map(|c| c * c).sum::<f32>() - 1.0).abs() < 1e-5);
        }
        let (mut chi2, mut cells) = (0.0, 0);
        for (at, hit) in hits.iter().enumerate() {
            let (row, column) = (at / 12, at % 12);
            let expected = f64::from(map.density(row, column)) * map.solid_angle(row) * count as f64;
            if expected > 0.0 {
                chi2 += (hit - expected).powi(2) / expected;
                cells += 1;
            } else {
                assert!(*hit < 3.0, "rounding at an edge may put a few into a dark neighbour, not {hit}");
            }
        }
        let dof = f64::from(cells - 1);
        assert!((chi2 - dof).abs() < 5.0 * (2.0 * dof).sqrt(), "chi^2 = {chi2} of {dof}");
    }

    #[test]
    fn samples_stay_in_bounds_at_the_ends() {
        for map in [sky(12, 7, 1), Map::new(vec![0.0, 0.0, 1.0, 0.0, 0.0, 0.0], 6, 1, 1).expect("valid")] {
            for u in [f32::MIN_POSITIVE, 1e-9, 0.5, 1.0 - f32::EPSILON, 1.0] {
                for v in [f32::MIN_POSITIVE, 0.3, 1.0 - f32::EPSILON, 1.0] {
                    let (d, pdf) = map.sample(u, v);
                    assert!(d.iter().all(|c| c.is_finite()) && pdf > 0.0 && pdf.is_finite(), "({u}, {v})");
                }
            }
        }
        let dark = Map::new(vec![0.0; 12], 4, 3, 1).expect("valid");
        let (d, pdf) = dark.sample(0.3, 0.8);
        assert!(d.iter().all(|c| c.is_finite()) && pdf == 0.0);
    }

    #[test]
    fn the_power_on_a_box_is_the_integral_of_radiance_times_projected_area() {
        let size = [1.0, 2.5, 0.4];
        for (width, height, channels) in [(1, 1, 1), (2, 1, 1), (3, 2, 3), (16, 9, 1)] {
            let map = sky(width, height, channels);
            let power = map.projected(size);
            for c in 0..3 {
                let f = |d: [f32; 3]| f64::from(map.radiance(d)[c]) * projected_area(d.map(f64::from), size);
                let sum = over_sphere(1000, f);
                assert!((power[c] / sum - 1.0).abs() < 1e-4, "{width} x {height}: {} and {sum}", power[c]);
            }
        }
        let one = Map::new(vec![2.0; 12], 4, 3, 1).expect("valid").projected(size)[0];
        assert!((one / (2.0 * PI * 2.0 * (2.5 + 1.0 + 0.4)) - 1.0).abs() < 1e-8, "{one}");
    }

    #[test]
    fn photons_follow_radiance_times_projected_area() {
        let (size, map) = ([1.0, 2.5, 0.4], sky(8, 5, 3));
        let shower = Shower::new(&map, size);
        // The mean of some functions of direction and colour, against their integrals.
        let tests: [fn([f64; 3]) -> f64; 4] = [|d| d[0], |d| d[1], |d| d[2], |d| d[0] * d[1]];
        let count = 200_000u64;
        let mut sums = [[0.0f64; 2]; 12];
        for i in 0..count {
            let mut draws = Draws::new([5, 2], i, 3);
            let u = (i as f64 + uniform64(draws.next4()[0])) / count as f64;
            let more = || {
                let words = draws.next4();
                [0, 1, 2].map(|k| uniform64(words[k]))
            };
            let (d, colour) = shower.draw(u, more).expect("the map is not dark");
            assert!((colour.iter().sum::<f32>() - 3.0).abs() < 1e-5);
            for (at, sum) in sums.iter_mut().enumerate() {
                let value = tests[at / 3](d) * f64::from(colour[at % 3]);
                sum[0] += value;
                sum[1] += value * value;
            }
        }
        let power = map.projected(size);
        for (at, [sum, square]) in sums.into_iter().enumerate() {
            let truth = over_sphere(1000, |d| {
                let wide = d.map(f64::from);
                f64::from(map.radiance(d)[at % 3]) * projected_area(wide, size) * tests[at / 3](wide)
            }) / power[at % 3];
            let mean = sum / count as f64;
            let error = ((square / count as f64 - mean * mean) / count as f64).sqrt();
            assert!((mean - truth).abs() < 5.0 * error + 1e-4, "{at}: {mean} and {truth} within {error}");
        }
    }

    #[test]
    fn bad_texels_are_named() {
        let error = |value: f32, channels| {
            let mut texels = vec![1.0; 12 * channels];
            texels[7 * channels + channels / 2] = value;
            Map::new(texels, 4, 3, channels).expect_err("not valid").to_string()
        };
        assert!(error(f32::NAN, 1).contains("[1, 3]: NaN"));
        assert!(error(-1.0, 3).contains("[1, 3, 1]: -1"));
        assert!(error(f32::INFINITY, 1).contains("1 values"));
    }
}
