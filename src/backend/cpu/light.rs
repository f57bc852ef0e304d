//! Unscattered light: where it comes from at a point, and what of it arrives there.

mod fine;

use crate::backend::Control;
use crate::plan::Column;
use crate::scene::field::{Field, Occupancy, V3};
use crate::scene::{Light, Scene};
pub use fine::Fine;

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
