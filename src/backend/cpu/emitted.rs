//! Emitted light along a view ray: the integral of source term times transmittance, exact in every cell, however thick or
//! empty it is. In voxels of constant density it has a closed form; between voxel centres density and source term are cubic
//! along the ray, the optical depth quartic. Of pieces of at most half an optical depth four Gauss points integrate the source
//! term and its product with the optical depth exactly, what is of higher order to about 1e-6.

use super::light::GAUSS;
use crate::physics::Real;
use crate::physics::flight::mean_transmittance;
use crate::scene::Scene;
use crate::scene::field::{Corners, Field, V3};

/// Largest optical depth of a piece.
const PIECE: f64 = 0.5;
/// What lies behind this optical depth is not seen, however bright it is.
const UNSEEN: f64 = 50.0;
/// No piece is shorter than this part of a cell.
const SHORTEST: f64 = 1e-9;

/// The source term and the density that it is seen through.
pub struct Glow<'a> {
    density: Field<'a>,
    emission: Vec<Field<'a>>,
    extinction: [f64; 3],
}

impl<'a> Glow<'a> {
    /// That of a medium that emits.
    pub fn new(scene: &Scene<'a>) -> Option<Self> {
        let (medium, volume) = (&scene.medium, &scene.medium.volume);
        let emission = medium.emission.as_ref()?;
        // Empty blocks are not skipped: they may emit.
        Some(Glow {
            density: Field::density(volume),
            emission: (0..emission.channels()).map(|c| emission.field(c, volume)).collect(),
            extinction: medium.extinction.rgb,
        })
    }

    /// The emitted radiance that `p + t v`, t from 0 to `length`, sends to its start, by channel.
    pub fn along<const C: usize>(&self, p: V3, v: V3, length: f32) -> [f32; C] {
        let e = self.extinction;
        let same = e[0] == e[1] && e[1] == e[2];
        match *self.emission.as_slice() {
            [one] if same || C == 1 => [self.sum([one], e[0], p, v, length)[0] as f32; C],
            [r, g, b] if same => {
                let sum = self.sum([r, g, b], e[0], p, v, length);
                std::array::from_fn(|c| sum[c] as f32)
            }
            _ => std::array::from_fn(|c| {
                self.sum([self.emission[c % self.emission.len()]], e[c], p, v, length)[0] as f32
            }),
        }
    }

    /// The sums of some source terms under one extinction.
    fn sum<const K: usize>(&self, emission: [Field; K], extinction: f64, p: V3, v: V3, length: f32) -> [f64; K] {
        let (mut sum, mut depth) = ([0.0f64; K], 0.0f64);
        let linear = self.density.linear();
        self.density.visit(p, v, length, |cell, t0, t1| {
            let length = f64::from(t1 - t0);
            if linear {
                let enter: [f64; 3] = std::array::from_fn(|a| {
                    f64::from(p[a]) + f64::from(v[a]) * f64::from(t0) - 0.5 - f64::from(cell[a])
                });
                let way = v.map(|c| f64::from(c) * length);
                let sigma = self.density.corners(cell).cubic(enter, way).map(|c| c * extinction * length);
                let corners = emission.map(|field| field.corners(cell));
                if !corners.iter().all(Corners::is_zero) {
                    let shines = corners.map(|corners| corners.cubic(enter, way).map(|c| c * length));
                    add_cell(&mut sum, &shines, &sigma, depth);
                }
                depth += integral(&sigma, 1.0);
            } else {
                let tau = extinction * length * f64::from(self.density.voxel(cell));
                let seen = length * f64::from(mean_transmittance(tau as f32)) * (-depth).exp();
                for (sum, field) in sum.iter_mut().zip(&emission) {
                    *sum += seen * f64::from(field.voxel(cell));
                }
                depth += tau;
            }
            depth <= UNSEEN
        });
        sum
    }
}

/// Adds the light of a cell: `shines` and `sigma` are cubics over the cell, in units of its length, `depth` what lies
/// before it.
fn add_cell<const K: usize>(sum: &mut [f64; K], shines: &[[f64; 4]; K], sigma: &[f64; 4], depth: f64) {
    let (mut at, mut step, mut through) = (0.0f64, 1.0f64, (-depth).exp());
    while at < 1.0 && depth + integral(sigma, at) <= UNSEEN {
        let end = (at + step).min(1.0);
        if step > SHORTEST && integral(sigma, end) - integral(sigma, at) > PIECE {
            step *= 0.5;
            continue;
        }
        for &(x, w) in GAUSS[3] {
            let s = at + x * (end - at);
            let within = Real::exp((integral(sigma, at) - integral(sigma, s)) as f32);
            let seen = w * (end - at) * through * f64::from(within);
            for (sum, shines) in sum.iter_mut().zip(shines) {
                *sum += seen * value(shines, s);
            }
        }
        if end < 1.0 {
            through = (-depth - integral(sigma, end)).exp();
        }
        at = end;
        step *= 2.0;
    }
}

/// The value of a cubic.
fn value(c: &[f64; 4], s: f64) -> f64 {
    c[0] + s * (c[1] + s * (c[2] + s * c[3]))
}

/// Its integral from 0 to `s`.
fn integral(c: &[f64; 4], s: f64) -> f64 {
    s * (c[0] + s * (c[1] / 2.0 + s * (c[2] / 3.0 + s * c[3] / 4.0)))
}
