//! Order 1 of a light within a step of a view ray: in parts short enough that the depth towards the light changes little in
//! each. Under a low sun that depth grows many times as fast along a view ray as the depth towards the eye does.

use super::{Ray, Sums, View};
use crate::backend::cpu::light::{GAUSS, Illumination, Incident};
use crate::scene::field::{V3, along};

use super::close::Profile;

/// Change of the depth towards the light between the two Gauss points of a part: beyond, it is halved. Their rule is then
/// right to .2 %.
const LIT_DEPTH: f32 = 1.0;
/// What lies behind this depth is dark.
const DARK: f32 = 20.0;
/// The shortest part of a step.
const PARTS: u32 = 64;

impl<const C: usize, const S: usize> View<'_, C, S> {
    /// Adds a light's order 1 of a step, whose Gauss points are `nodes`.
    #[inline(always)]
    pub(super) fn lit(
        &self,
        sums: &mut Sums<C, S>,
        light: &Illumination,
        nodes: &[(V3, [f32; C]); 2],
        ray: &Ray,
        start: f32,
        profile: &Profile,
    ) {
        let arriving = [0, 1].map(|i| arrive(light, nodes[i].0));
        let columns = arriving.map(|(_, column)| column);
        if !(self.is_steep(columns, LIT_DEPTH)
            && is_even(light, columns, along(ray.p, ray.v, start + 0.5 * profile.step)))
        {
            for ((_, factor), (incident, column)) in nodes.iter().zip(&arriving) {
                self.add_lit(sums, light, factor, incident, *column, ray);
            }
            return;
        }
        let (mut at, mut width) = (0, PARTS / 2);
        while at < PARTS {
            let (from, part) = (at as f32 / PARTS as f32, width as f32 / PARTS as f32);
            let places = [0, 1].map(|i| from + GAUSS[1][i].0 as f32 * part);
            let points = places.map(|u| along(ray.p, ray.v, start + u * profile.step));
            let arriving = points.map(|p| arrive(light, p));
            if width > 1 && self.is_steep(arriving.map(|(_, column)| column), LIT_DEPTH) {
                width /= 2;
                continue;
            }
            for i in 0..2 {
                let weight = profile.density(places[i]) * 0.5 * part * profile.step;
                let factor = self.factor(points[i], weight, sums.column + profile.column(places[i]));
                self.add_lit(sums, light, &factor, &arriving[i].0, arriving[i].1, ray);
            }
            at += width;
            // A part begins at a multiple of its width, and may be twice as wide as the one before.
            if at % (2 * width) == 0 && width < PARTS / 2 {
                width *= 2;
            }
        }
    }

    /// Whether the depth towards a light changes by more than `most` between two points, unless all around them is dark.
    #[inline(always)]
    pub(in crate::backend::cpu) fn is_steep(&self, columns: [f32; 2], most: f32) -> bool {
        let change = (columns[1] - columns[0]).abs();
        // On the line through two Gauss points, the column at the brighter end: .366 of their distance beyond.
        let least = columns[0].min(columns[1]) - 0.366 * change;
        change * self.most_extinction > most && least * self.least_extinction < DARK
    }

    /// Adds what a light sends through a node to the eye.
    #[inline(always)]
    fn add_lit(
        &self,
        sums: &mut Sums<C, S>,
        light: &Illumination,
        factor: &[f32; C],
        incident: &Incident,
        column: f32,
        ray: &Ray,
    ) {
        let scattered = incident.falloff * self.toward_eye(&incident.direction, &ray.direction);
        for c in 0..C {
            sums.order1[c] += factor[c] * light.value[c] * scattered * (-self.extinction[c] * column).exp();
        }
    }
}

/// A light's direction at a point, and the column density towards it.
#[inline(always)]
fn arrive(light: &Illumination, p: V3) -> (Incident, f32) {
    let incident = light.incident(p);
    let column = light.column(p, &incident);
    (incident, column)
}

/// Whether the column density in the middle between two points is about halfway between theirs: the depth grows steadily,
/// and parts of the step resolve it. At the edge of a shadow it jumps, and they would not.
#[inline(always)]
fn is_even(light: &Illumination, columns: [f32; 2], middle: V3) -> bool {
    let (_, column) = arrive(light, middle);
    (column - 0.5 * (columns[0] + columns[1])).abs() < 0.1 * (columns[1] - columns[0]).abs()
}
