//! Unscattered light: where it comes from at a point, and what of it arrives there.

mod fine;

use super::track::enter;
use crate::backend::Control;
use crate::physics::flight::{mean_transmittance, rectangle_solid_angle};
use crate::plan::{Column, points_for};
use crate::scene::field::{Dda, Field, Occupancy, V3, along};
use crate::scene::{Light, Scene};
pub use fine::Fine;
use rayon::prelude::*;

/// Nodes and weights of Gauss-Legendre quadrature on [0, 1] with 1 to 4 points.
pub const GAUSS: [&[(f64, f64)]; 4] = [
    &[(0.5, 1.0)],
    &[(0.211_324_865_405_187_1, 0.5), (0.788_675_134_594_812_9, 0.5)],
    &[
        (0.112_701_665_379_258_3, 0.277_777_777_777_777_8),
        (0.5, 0.444_444_444_444_444_4),
        (0.887_298_334_620_741_7, 0.277_777_777_777_777_8),
    ],
    &[
        (0.069_431_844_202_973_7, 0.173_927_422_568_726_9),
        (0.330_009_478_207_571_9, 0.326_072_577_431_273_1),
        (0.669_990_521_792_428_1, 0.326_072_577_431_273_1),
        (0.930_568_155_797_026_3, 0.173_927_422_568_726_9),
    ],
];

/// A light that reaches each point from one direction.
#[derive(Debug, Clone, Copy)]
pub enum Source {
    /// A point, in voxel coordinates.
    Point(V3),
    /// Parallel light travelling along a unit vector.
    Directional(V3),
}

/// Unscattered light at a point.
#[derive(Debug, Clone, Copy)]
pub struct Incident {
    /// Unit vector along which it travels.
    pub direction: V3,
    /// 1 / distance^2 of a point light; 1 for parallel light.
    pub falloff: f32,
    /// Way from the light; infinite for parallel light.
    pub distance: f32,
}

/// A point or directional light seen from within the volume.
#[derive(Debug, Clone)]
pub struct Illumination<'a> {
    /// Where it comes from.
    pub source: Source,
    /// Intensity or irradiance by channel.
    pub value: [f32; 3],
    field: Field<'a>,
    h: V3,
    nodes: Option<&'a [f32]>,
    fine: Option<&'a Fine>,
    rays: bool,
    enough: f32,
    /// Column density that light can meet within one voxel.
    reach: f32,
}

impl<'a> Illumination<'a> {
    /// The view of a light; `None` for beams and environments. `nodes` are its column densities at
    /// the nodes of the light grid.
    pub fn new(
        scene: &Scene<'a>,
        occupancy: Option<&'a Occupancy>,
        light: &Light,
        column: Column,
        nodes: Option<&'a [f32]>,
    ) -> Option<Self> {
        let volume = &scene.medium.volume;
        let h = volume.spacing();
        let source = match light {
            Light::Point { position, .. } => {
                let p = volume.local(*position);
                Source::Point(std::array::from_fn(|a| (p[a] / h[a]) as f32))
            }
            Light::Directional { direction, .. } => Source::Directional(direction.map(|c| c as f32)),
            Light::Pencil { .. } | Light::Environment { .. } => return None,
        };
        Some(Illumination {
            source,
            value: light.value().rgb.map(|v| v as f32),
            field: Field::density(volume).skipping(occupancy),
            h: h.map(|c| c as f32),
            nodes,
            fine: None,
            rays: column == Column::Rays || nodes.is_none(),
            reach: volume.max() * h.iter().map(|h| h * h).sum::<f64>().sqrt() as f32,
            // What is behind 40 mean free paths is dark, in all channels.
            enough: (40.0 / scene.medium.extinction.rgb.iter().fold(f64::INFINITY, |m, &e| m.min(e))) as f32,
        })
    }

    /// The same view, which interpolates columns between finer nodes.
    pub fn between(self, fine: &'a Fine) -> Self {
        Illumination { fine: Some(fine), ..self }
    }

    /// Whether columns are interpolated between finer nodes than those of the light grid.
    #[inline(always)]
    pub fn is_fine(&self) -> bool {
        self.fine.is_some()
    }

    /// Direction and falloff at a point.
    #[inline(always)]
    pub fn incident(&self, p: V3) -> Incident {
        match self.source {
            Source::Point(light) => {
                let r: V3 = std::array::from_fn(|a| (p[a] - light[a]) * self.h[a]);
                let d2 = (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]).max(1e-30);
                let distance = d2.sqrt();
                Incident { direction: r.map(|c| c / distance), falloff: 1.0 / d2, distance }
            }
            Source::Directional(direction) => Incident { direction, falloff: 1.0, distance: f32::INFINITY },
        }
    }

    /// 1 / distance^2 of a point light, 1 for parallel light.
    #[inline(always)]
    pub fn falloff(&self, p: V3) -> f32 {
        match self.source {
            Source::Point(light) => {
                let r: V3 = std::array::from_fn(|a| (p[a] - light[a]) * self.h[a]);
                let d2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2];
                1.0 / if d2 > 1e-30 { d2 } else { 1e-30 }
            }
            Source::Directional(_) => 1.0,
        }
    }

    /// The column density between the light and a point: interpolated, or by a light ray where that would be wrong.
    #[inline(always)]
    pub fn column(&self, p: V3, incident: &Incident) -> f32 {
        match (self.nodes, self.fine) {
            _ if self.is_near(p) => self.ray(p, incident),
            (_, Some(fine)) => fine.at(p),
            (Some(nodes), None) if !self.rays => interpolate_nodes(nodes, self.field.n(), p),
            _ => self.ray(p, incident),
        }
    }

    /// The column density between the light and a point that holds any density.
    #[inline(always)]
    pub fn column_at(&self, p: V3) -> f32 {
        match self.fine {
            Some(fine) if !self.is_near(p) => fine.at(p),
            _ => self.column(p, &self.incident(p)),
        }
    }

    /// The light grid, if columns are interpolated in it.
    pub fn nodes(&self) -> Option<&'a [f32]> {
        self.nodes.filter(|_| !self.rays)
    }

    /// The nodes of its light grid along x, y, z.
    pub fn layers(&self) -> [usize; 3] {
        self.field.n().map(|m| m as usize + 2)
    }

    /// The light grid, if there is one, whether or not columns are interpolated in it.
    pub fn grid(&self) -> Option<&'a [f32]> {
        self.nodes
    }

    /// The column density interpolated in the light grid, a bound of order for importance sampling everywhere.
    #[inline(always)]
    pub fn rough_column(&self, p: V3, incident: &Incident) -> f32 {
        match self.nodes {
            Some(nodes) => interpolate_nodes(nodes, self.field.n(), p),
            None => self.ray(p, incident),
        }
    }

    /// Close to a point light the depth has the kink of a cone, and is not interpolated.
    #[inline(always)]
    fn is_near(&self, p: V3) -> bool {
        match self.source {
            Source::Point(light) => (0..3).all(|a| (p[a] - light[a]).abs() < 2.0),
            Source::Directional(_) => false,
        }
    }

    /// The column density by a light ray, exact.
    #[inline(always)]
    pub fn ray(&self, p: V3, incident: &Incident) -> f32 {
        let v: V3 = std::array::from_fn(|a| -incident.direction[a] / self.h[a]);
        self.field.column_up_to(p, v, incident.distance, self.enough)
    }

    /// Whether a voxel may hold any density.
    #[inline(always)]
    pub fn occupied(&self, voxel: [usize; 3]) -> bool {
        self.field.occupied(voxel)
    }

    /// The density at a point.
    #[inline(always)]
    pub fn density(&self, p: V3) -> f32 {
        self.field.at(p)
    }

    /// The column density that light can meet within one voxel.
    pub fn reach(&self) -> f32 {
        self.reach
    }

    /// The column densities at the nodes of the light grid: the voxel centres, and one layer of centres beyond each face,
    /// where they are such that interpolation is right on the face. [nx + 2][ny + 2][nz + 2] values, x fastest.
    pub fn columns(&self, control: &Control) -> Vec<f32> {
        super::sweep::columns(&self.field, self.h, self.source, control)
    }
}

/// Interpolates between the nodes of the light grid.
#[inline(always)]
fn interpolate_nodes(nodes: &[f32], n: [i32; 3], p: V3) -> f32 {
    let q: V3 = std::array::from_fn(|a| (p[a] + 0.5).max(0.0));
    let cell: [usize; 3] = std::array::from_fn(|a| (q[a] as usize).min(n[a] as usize));
    let u: V3 = std::array::from_fn(|a| q[a] - cell[a] as f32);
    let (row, slice) = (n[0] as usize + 2, (n[0] as usize + 2) * (n[1] as usize + 2));
    let base = cell[2] * slice + cell[1] * row + cell[0];
    let c = nodes;
    let x = |at: usize| c[at] + u[0] * (c[at + 1] - c[at]);
    let y0 = x(base);
    let y0 = y0 + u[1] * (x(base + row) - y0);
    let y1 = x(base + slice);
    let y1 = y1 + u[1] * (x(base + slice + row) - y1);
    (y0 + u[2] * (y1 - y0)).max(0.0)
}

/// The mean unscattered fluence of voxel `cell`, per channel, for a light of one direction a point, by `points`^3 Gauss
/// points. With `rays` each has a light ray; else the columns of the light grid are shifted to be right at the centre.
pub fn voxel_fluence(
    light: &Illumination,
    extinction: &[f32; 3],
    (points, rays): (usize, bool),
    cell: [i32; 3],
) -> Quadrature {
    let centre: V3 = cell.map(|c| c as f32 + 0.5);
    if let Source::Point(position) = light.source
        && is_next_to(light, cell)
    {
        let fluence = near_fluence(light, extinction, cell, position);
        let density = light.field.at(centre);
        return Quadrature { fluence, collisions: fluence.map(|f| f * density) };
    }
    let mut points = points;
    if points > 4 {
        if light.rough_column(centre, &light.incident(centre)) - light.reach > light.enough {
            return Quadrature { fluence: [0.0; 3], collisions: [0.0; 3] };
        }
        // The plan's number is that of the densest voxel.
        let side = light.h[0].max(light.h[1]).max(light.h[2]);
        let depth = light.field.maximum(cell) * extinction.iter().fold(0.0f32, |m, &e| m.max(e)) * side;
        points = points.min(points_for(f64::from(depth)).max(4));
    }
    let rule = GAUSS[points.clamp(1, 4) - 1];
    let pieces = points.div_ceil(4);
    let node = |at: usize| {
        let (x, w) = rule[at % rule.len()];
        (((at / rule.len()) as f32 + x as f32) / pieces as f32, w as f32 / pieces as f32)
    };
    let shift = if light.rays && !rays {
        let incident = light.incident(centre);
        light.ray(centre, &incident) - light.rough_column(centre, &incident)
    } else {
        0.0
    };
    let per_axis = rule.len() * pieces;
    let mut sum = Quadrature { fluence: [0.0; 3], collisions: [0.0; 3] };
    for at in 0..per_axis * per_axis * per_axis {
        let nodes = [node(at % per_axis), node(at / per_axis % per_axis), node(at / (per_axis * per_axis))];
        let p: V3 = std::array::from_fn(|a| cell[a] as f32 + nodes[a].0);
        let incident = light.incident(p);
        let column = if rays { light.ray(p, &incident) } else { (light.rough_column(p, &incident) + shift).max(0.0) };
        let weight = nodes[0].1 * nodes[1].1 * nodes[2].1 * incident.falloff;
        let density = light.field.at(p);
        for c in 0..3 {
            let fluence = weight * light.value[c] * (-extinction[c] * column).exp();
            sum.fluence[c] += fluence;
            sum.collisions[c] += fluence * density;
        }
    }
    sum
}

/// Means over a voxel, by channel.
#[derive(Debug, Clone, Copy)]
pub struct Quadrature {
    /// Of the unscattered fluence.
    pub fluence: [f32; 3],
    /// Of density * unscattered fluence, of which the extinction makes collisions.
    pub collisions: [f32; 3],
}

/// Pieces of a face along each axis, of 4^2 Gauss points each, next to a point light.
pub const PIECES: usize = 4;

/// Whether a voxel is next to a light, or around it.
pub fn is_next_to(light: &Illumination, cell: [i32; 3]) -> bool {
    match light.source {
        Source::Point(position) => (0..3).all(|a| (cell[a] as f32 + 0.5 - position[a]).abs() < 3.0),
        Source::Directional(_) => false,
    }
}

/// The same next to a point light, or around it, where 1/d^2 is no polynomial: the volume integral in the light's
/// spherical coordinates, as signed integrals over the voxel's faces of (cosine / d^2) * integral of exp(-depth) dr.
fn near_fluence(light: &Illumination, extinction: &[f32; 3], cell: [i32; 3], position: V3) -> [f32; 3] {
    let h = light.h.map(f64::from);
    let rule = GAUSS[3];
    let mut sum = [0.0f64; 3];
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for side in 0..2 {
            let plane = f64::from(cell[axis] + side);
            let distance = (plane - f64::from(position[axis])) * h[axis] * if side == 1 { 1.0 } else { -1.0 };
            if distance <= 0.0 {
                continue;
            }
            for at in 0..PIECES * PIECES * 16 {
                let (piece, node) = (at / 16, at % 16);
                let (xu, wu) = rule[node % 4];
                let (xv, wv) = rule[node / 4];
                let mut point = [0.0f64; 3];
                point[axis] = plane;
                point[u] = f64::from(cell[u]) + ((piece % PIECES) as f64 + xu) / PIECES as f64;
                point[v] = f64::from(cell[v]) + ((piece / PIECES) as f64 + xv) / PIECES as f64;
                let r: [f64; 3] = std::array::from_fn(|a| (point[a] - f64::from(position[a])) * h[a]);
                let d2 = r.iter().map(|c| c * c).sum::<f64>();
                let d = d2.sqrt();
                let solid_angle = wu * wv * h[u] * h[v] / (PIECES * PIECES) as f64 * distance / (d2 * d);
                let end = point.map(|c| c as f32);
                let incident = light.incident(end);
                // The part of the ray within the voxel, as parts of its whole; it ends at this face.
                let enter = (0..3)
                    .map(|a| {
                        let (low, way) =
                            (f64::from(cell[a]) - f64::from(position[a]), point[a] - f64::from(position[a]));
                        if way == 0.0 { 0.0 } else { (low / way).min((low + 1.0) / way) }
                    })
                    .fold(0.0, f64::max);
                if enter >= 1.0 {
                    continue;
                }
                for &(x, w) in rule {
                    let x = enter + (1.0 - enter) * x;
                    let part: V3 = std::array::from_fn(|a| position[a] + (end[a] - position[a]) * x as f32);
                    let here = Incident { distance: incident.distance * x as f32, ..incident };
                    let column = light.ray(part, &here);
                    for c in 0..3 {
                        sum[c] += solid_angle * w * (1.0 - enter) * d * f64::from((-extinction[c] * column).exp());
                    }
                }
            }
        }
    }
    let volume = h[0] * h[1] * h[2];
    std::array::from_fn(|c| (sum[c].max(0.0) / volume * f64::from(light.value[c])) as f32)
}

/// A pencil beam's unscattered fluence: calls `deposit(voxel, fluence * volume, per unit of power)` along its way, and
/// returns the column density of the whole way, or `None` if it misses the box.
pub fn beam(
    scene: &Scene,
    position: [f64; 3],
    direction: [f64; 3],
    mut deposit: impl FnMut(usize, [f64; 3]),
) -> Option<f64> {
    let volume = &scene.medium.volume;
    let field = Field::density(volume);
    let (p, v, length) = beam_entry(scene, position, direction)?;
    // Half voxels, in parts: within each the density is nearly constant.
    let mut cells = Dda::new(p.map(|c| c * 2.0), v.map(|c| c * 2.0), [0; 3], field.n().map(|m| 2 * m));
    let (mut t, mut column) = (0.0f32, 0.0f64);
    loop {
        let (axis, exit) = cells.exit();
        let stop = exit.min(length);
        if stop > t {
            let parts = if field.linear() { 4 } else { 1 };
            for part in 0..parts {
                let step = (stop - t) / parts as f32;
                let start = t + step * part as f32;
                let voxel = cells.cell.map(|c| c / 2);
                let piece = if field.linear() { field.at(along(p, v, start + 0.5 * step)) } else { field.voxel(voxel) };
                let piece = f64::from(piece) * f64::from(step);
                deposit(
                    field.index(voxel),
                    scene.medium.extinction.rgb.map(|e| {
                        (-e * column).exp() * f64::from(step) * f64::from(mean_transmittance((e * piece) as f32))
                    }),
                );
                column += piece;
            }
            t = stop;
        }
        if exit >= length || !cells.advance(axis) {
            return Some(column);
        }
    }
}

/// Where a beam enters the box: voxel coordinates, velocity, and length within.
pub fn beam_entry(scene: &Scene, position: [f64; 3], direction: [f64; 3]) -> Option<(V3, V3, f32)> {
    let volume = &scene.medium.volume;
    let (h, n) = (volume.spacing(), volume.n().map(|m| m as i32));
    let start = volume.local(position);
    let p: [f64; 3] = std::array::from_fn(|a| start[a] / h[a]);
    let v: [f64; 3] = std::array::from_fn(|a| direction[a] / h[a]);
    let (t0, t1) = enter(p, v, n)?;
    let at: V3 = std::array::from_fn(|a| (p[a] + v[a] * t0).clamp(0.0, f64::from(n[a])) as f32);
    Some((at, v.map(|c| c as f32), (t1 - t0) as f32))
}

/// The unscattered light that leaves through the box's faces per unit of the light's value, by channel, and an estimate
/// of the quadrature's error.
pub fn unscattered(scene: &Scene, light: &Illumination) -> ([f64; 3], f64) {
    let volume = &scene.medium.volume;
    let (h, n) = (volume.spacing(), volume.n());
    let extinction = scene.medium.extinction.rgb;
    let mut total = ([0.0; 3], 0.0);
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for side in [0.0, 1.0] {
            let plane = side * n[axis] as f64;
            let sign = 2.0 * side - 1.0;
            let face = |at: usize| -> ([f64; 3], f64) {
                let (i, j) = ((at % n[u]) as f64, (at / n[u]) as f64);
                // Flux through the face of one voxel in vacuum: irradiance * cosine * area, or the solid angle.
                let flux = match light.source {
                    Source::Directional(d) => f64::from(d[axis]) * sign * h[u] * h[v],
                    Source::Point(p) => {
                        let p = p.map(f64::from);
                        let z = (plane - p[axis]) * sign * h[axis];
                        if z <= 0.0 {
                            return ([0.0; 3], 0.0);
                        }
                        rectangle_solid_angle(
                            (i - p[u]) * h[u],
                            (i + 1.0 - p[u]) * h[u],
                            (j - p[v]) * h[v],
                            (j + 1.0 - p[v]) * h[v],
                            z,
                        )
                    }
                };
                if flux <= 0.0 {
                    return ([0.0; 3], 0.0);
                }
                let transmittance = |x: f64, y: f64| -> [f64; 3] {
                    let mut point = [0.0f32; 3];
                    point[axis] = plane as f32;
                    point[u] = (i + x) as f32;
                    point[v] = (j + y) as f32;
                    let column = f64::from(light.column(point, &light.incident(point)));
                    extinction.map(|e| (-e * column).exp())
                };
                let centre = transmittance(0.5, 0.5);
                let mut mean = [0.0; 3];
                for (x, y) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    let t = transmittance(GAUSS[1][x].0, GAUSS[1][y].0);
                    for c in 0..3 {
                        mean[c] += 0.25 * t[c];
                    }
                }
                let error = (0..3).map(|c| (mean[c] - centre[c]).abs()).fold(0.0, f64::max);
                (mean.map(|m| m * flux), error * flux)
            };
            let sum = (0..n[u] * n[v])
                .into_par_iter()
                .with_min_len(256)
                .map(face)
                .reduce(|| ([0.0; 3], 0.0), |a, b| (std::array::from_fn(|c| a.0[c] + b.0[c]), a.1 + b.1));
            total = (std::array::from_fn(|c| total.0[c] + sum.0[c]), total.1 + sum.1);
        }
    }
    total
}
