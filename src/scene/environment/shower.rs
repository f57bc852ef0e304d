//! The light of a map that falls on a box: directions for photons.

use super::table::Table;
use super::{Map, faces};
use std::f64::consts::PI;

/// Draws the directions of a map's light that meets a box, by radiance (summed over channels, each over its mean) times
/// projected area.
#[derive(Debug)]
pub struct Shower<'a> {
    map: &'a Map,
    faces: [f64; 3],
    /// What makes each channel's mean 1; 0 where it is dark.
    factors: [f32; 3],
    /// The most that radiance times projected area reaches in each texel, times the texel's solid angle.
    bounds: Table,
}

/// What makes the mean of each channel 1: what is drawn by all channels together serves each of them then, however
/// unlike they are. A single channel stays as it is.
pub fn per_mean(means: &[f64]) -> [f32; 3] {
    let factor = |mean: &f64| if *mean > 0.0 { mean.recip().min(f64::from(f32::MAX)) as f32 } else { 0.0 };
    match means {
        [_] => [1.0, 0.0, 0.0],
        _ => std::array::from_fn(|c| means.get(c).map_or(0.0, factor)),
    }
}

/// The weights of what is drawn by the sum of `values` times [`per_mean`]: their means are 1.
#[inline(always)]
pub fn weights(values: [f32; 3], factors: [f32; 3]) -> [f32; 3] {
    let parts: [f32; 3] = std::array::from_fn(|c| values[c] * factors[c]);
    let lit = factors.iter().filter(|&&factor| factor > 0.0).count() as f32;
    let sum: f32 = parts.iter().sum();
    if sum > 0.0 { parts.map(|part| part / sum * lit) } else { [0.0; 3] }
}

/// Chance below which a direction is never refused that should not be.
const ROUNDING: f64 = 1.0 + 1e-5;

impl<'a> Shower<'a> {
    /// The light of a map that falls on a box of the given size.
    pub fn new(map: &'a Map, size: [f64; 3]) -> Self {
        let faces = faces(size);
        let most = |from: f64, to: f64, f: fn(f64) -> f64, peak: f64| {
            // |sin| and |cos| reach 1 at their peaks, which are half a turn apart.
            let holds = ((from - peak) / PI).ceil() * PI + peak <= to;
            if holds { 1.0 } else { f(from).abs().max(f(to).abs()) }
        };
        let [top, wide] = [PI / map.height as f64, 2.0 * PI / map.width as f64];
        let rows: Vec<[f64; 2]> = (0..map.height)
            .map(|row| (row as f64 * top, (row + 1) as f64 * top))
            .map(|(from, to)| [most(from, to, f64::cos, 0.0), most(from, to, f64::sin, 0.5 * PI)])
            .collect();
        let columns: Vec<f64> = (0..map.width)
            .map(|column| (column as f64 * wide - PI, (column + 1) as f64 * wide - PI))
            .map(|(from, to)| faces[0] * most(from, to, f64::sin, 0.5 * PI) + faces[1] * most(from, to, f64::cos, 0.0))
            .collect();
        let surface = PI * 2.0 * faces.iter().sum::<f64>();
        let factors = per_mean(&map.projected(size).map(|power| power / surface)[..map.channels]);
        let bounds = Table::new(map.width, map.height, |row, column| {
            let area = faces[2] * rows[row][0] + rows[row][1] * columns[column];
            map.most(row, column, &factors) * ROUNDING * area * map.solid_angle(row)
        });
        Shower { map, faces, factors, bounds }
    }

    /// 1 or 3.
    pub fn channels(&self) -> usize {
        self.map.channels
    }

    /// What makes each channel's mean 1; 0 where it is dark.
    pub fn factors(&self) -> [f32; 3] {
        self.factors
    }

    /// The map.
    pub fn map(&self) -> &'a Map {
        self.map
    }

    /// The masses of its texels, from which directions are drawn.
    pub fn bounds(&self) -> &Table {
        &self.bounds
    }

    /// A unit vector to the sky, and the weight of each channel there, whose mean is 1. `u` within (0, 1) may be stratified;
    /// `more` gives three more uniform numbers a call. `None` only for a dark map.
    pub fn draw(&self, u: f64, mut more: impl FnMut() -> [f64; 3]) -> Option<([f64; 3], [f32; 3])> {
        let map = self.map;
        let (mut u, mut words) = (u, more());
        // What is refused is at most some twenty times as much as what is not: the end is never reached.
        for _ in 0..1 << 16 {
            let (row, rest) = self.bounds.row(u);
            let (column, y) = self.bounds.column(row, rest);
            let (d, at) = map.direction(row, column, words[0], y);
            let radiance = map.at((column as f64 + words[0]) as f32, at as f32);
            let sum: f32 =
                radiance[..map.channels].iter().zip(&self.factors).map(|(value, factor)| value * factor).sum();
            let area = (0..3).map(|a| d[a].abs() * self.faces[a]).sum::<f64>();
            let bound = self.bounds.mass(row, column) / map.solid_angle(row);
            if f64::from(sum) * area > words[1] * bound {
                return Some((d, weights(radiance, self.factors)));
            }
            u = words[2];
            words = more();
        }
        None
    }
}
