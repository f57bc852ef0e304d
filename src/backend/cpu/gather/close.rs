//! Point lights close to a view ray, where 1 / distance^2 is no polynomial.

use super::{Ray, Sums, View};
use crate::backend::cpu::light::{GAUSS, Illumination, Source};
use crate::scene::field::{V3, along};

impl<const C: usize, const S: usize> View<'_, C, S> {
    /// A step that passes close to a point light: nodes equally spaced in the angle seen from the light, in which 1/d^2
    /// is constant (Kulla and Fajardo, *Importance sampling techniques for path tracing in participating media*, 2012).
    pub(super) fn close(
        &self,
        sums: &mut Sums<C, S>,
        light: &Illumination,
        (foot, off): (f32, f32),
        ray: &Ray,
        start: f32,
        profile: &Profile,
    ) {
        let step = profile.step;
        let off = off.max(ray.least_off).max(1e-6 * step);
        let (from, to) = ((-foot / off).atan(), ((step - foot) / off).atan());
        for piece in 0..2 {
            for &(x, w) in GAUSS[3] {
                let angle = from + (to - from) * (piece as f32 + x as f32) * 0.5;
                let t = (foot + off * angle.tan()).clamp(0.0, step);
                let d2 = off * off + (t - foot) * (t - foot);
                let length = w as f32 * 0.5 * (to - from) * d2 / off;
                let at = along(ray.p, ray.v, start + t);
                let u = t / step;
                let factor: [f32; C] = self.factor(at, profile.density(u) * length, sums.column + profile.column(u));
                let incident = light.incident(at);
                let column = light.ray(at, &incident);
                let scattered = self.toward_eye(&incident.direction, &ray.direction) / d2;
                for c in 0..C {
                    sums.order1[c] += factor[c] * light.value[c] * scattered * (-self.extinction[c] * column).exp();
                }
            }
        }
    }
}

/// The density along a step, linear through its two Gauss points; `u` runs from 0 to 1.
pub struct Profile {
    pub s1: f32,
    pub slope: f32,
    pub step: f32,
}

impl Profile {
    #[inline(always)]
    pub fn density(&self, u: f32) -> f32 {
        (self.s1 + self.slope * (u - GAUSS[1][0].0 as f32)).max(0.0)
    }

    /// The integral of the density over the first `u` of the step.
    #[inline(always)]
    pub fn column(&self, u: f32) -> f32 {
        (self.s1 * u + self.slope * (0.5 * u * u - GAUSS[1][0].0 as f32 * u)) * self.step
    }
}

/// A light nearer than this many steps is integrated by angle.
const CLOSE: f32 = 4.0;

/// For a step that starts at `p`: the parameter of the point nearest to the light and its distance, if it is close.
#[inline(always)]
pub fn close_light(light: &Illumination, h: [f64; 3], p: V3, direction: V3, step: f32) -> Option<(f32, f32)> {
    let Source::Point(position) = light.source else { return None };
    let to: V3 = std::array::from_fn(|a| (position[a] - p[a]) * h[a] as f32);
    let foot = (0..3).map(|a| to[a] * direction[a]).sum::<f32>();
    let off = (0..3).map(|a| (to[a] - foot * direction[a]).powi(2)).sum::<f32>().sqrt();
    let middle = 0.5 * step - foot;
    (off * off + middle * middle < (CLOSE * step) * (CLOSE * step)).then_some((foot, off))
}
