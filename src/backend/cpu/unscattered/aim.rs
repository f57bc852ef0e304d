//! Rays of a light through the box, as points of a lattice with a random shift. Rays for the energy balance are aimed at
//! whole faces through which light leaves, so that their weights add up to all that the box receives. Rays for the voxels
//! are aimed at unit cells of a plane, with the same lattice in each.
//!
//! Of parallel light that plane is normal to the axis along which the light crosses most voxels. There a voxel's chord, as a
//! function of the point that a ray is aimed at, has a Fourier transform that is a product of sincs and vanishes at all
//! integer frequencies but 0: the sum over a lattice that repeats in each cell is the voxel's volume, exactly, for any shift.

use super::walk::Way;
use crate::physics::flight::box_range;
use crate::physics::lattice::Lattice;
use crate::physics::solid_angle::{SphericalRectangle, rectangle_solid_angle};
use crate::scene::{Light, Volume};

/// Where rays come from.
#[derive(Debug, Clone, Copy)]
pub enum Source {
    /// A point, in voxel coordinates.
    Point([f64; 3]),
    /// Parallel light along a unit vector.
    Parallel([f64; 3]),
}

/// A light, as rays are aimed from it.
#[derive(Debug, Clone, Copy)]
pub struct Aim {
    /// Where the rays come from.
    pub source: Source,
    n: [f64; 3],
    h: [f64; 3],
}

/// A rectangle of a plane normal to an axis, at which rays are aimed.
#[derive(Debug, Clone, Copy)]
struct Patch {
    axis: usize,
    plane: f64,
    low: [f64; 2],
    high: [f64; 2],
}

/// Points light up at most this many cells of a plane more often than others.
const MOST: f64 = 1e6;

impl Aim {
    /// That of a light; `None` for beams and environments.
    pub fn new(volume: &Volume, light: &Light) -> Option<Self> {
        let h = volume.spacing();
        let source = match light {
            Light::Point { position, .. } => {
                let p = volume.local(*position);
                Source::Point(std::array::from_fn(|a| p[a] / h[a]))
            }
            Light::Directional { direction, .. } => Source::Parallel(*direction),
            Light::Pencil { .. } | Light::Environment { .. } => return None,
        };
        Some(Aim { source, n: volume.n().map(|m| m as f64), h })
    }

    /// Whether it is a point light.
    pub fn is_point(&self) -> bool {
        matches!(self.source, Source::Point(_))
    }

    /// The faces through which light leaves the box, as (axis, side, flux through the face in vacuum).
    fn faces(&self) -> Vec<(usize, f64, f64)> {
        let (n, h) = (self.n, self.h);
        let mut faces = Vec::new();
        for axis in 0..3 {
            let [u, v] = beside(axis);
            for plane in [0.0, n[axis]] {
                let out = if plane > 0.0 { h[axis] } else { -h[axis] };
                let flux = match self.source {
                    Source::Parallel(d) => d[axis] * out.signum() * n[u] * h[u] * n[v] * h[v],
                    Source::Point(p) => match (plane - p[axis]) * out {
                        z if z > 0.0 => rectangle_solid_angle(
                            -p[u] * h[u],
                            (n[u] - p[u]) * h[u],
                            -p[v] * h[v],
                            (n[v] - p[v]) * h[v],
                            z,
                        ),
                        _ => 0.0,
                    },
                };
                if flux > 0.0 {
                    faces.push((axis, plane, flux));
                }
            }
        }
        faces
    }

    /// The light that the box receives, per unit of the light's value: irradiance times projected area, or the solid angle.
    pub fn flux(&self) -> f64 {
        self.faces().iter().map(|face| face.2).sum()
    }

    /// About `rays` rays, aimed at whole faces: `f(way, flux)`. The fluxes add up to all that the box receives; a ray that
    /// touches an edge only has a way of no length.
    pub fn over_faces(&self, rays: f64, shift: [f64; 2], mut f: impl FnMut(&Way, f64)) {
        let faces = self.faces();
        let all: f64 = faces.iter().map(|face| face.2).sum();
        for (axis, plane, flux) in faces {
            let [u, v] = beside(axis);
            let patch = Patch { axis, plane, low: [0.0; 2], high: [self.n[u], self.n[v]] };
            let lattice = Lattice::of((rays * flux / all).max(34.0));
            let mut list = Vec::with_capacity(lattice.points() as usize);
            self.over_patch(&patch, flux > 1e-4, lattice, shift, |way, weight| list.push((way, weight)));
            // Of faces far away, on which points are even in area, the weights add up but nearly.
            let sum: f64 = list.iter().map(|ray| ray.1).sum();
            list.iter().for_each(|(way, weight)| {
                let nothing = Way { p: [0.0; 3], v: [0.0; 3], length: 0.0 };
                f(way.as_ref().unwrap_or(&nothing), weight * flux / sum);
            });
        }
    }

    /// The rows of patches that rays for the voxels are aimed at. A patch is a cell of a plane; if `sparse`, those of a point
    /// light are as large as leaves about half a ray for each voxel at the plane.
    pub fn rows(&self, sparse: bool) -> Vec<Row> {
        let mut rows = Vec::new();
        let mut add = |axis: usize, plane: f64, [u0, u1]: [f64; 2], [v0, v1]: [f64; 2], size: [i64; 2]| {
            let (u, v) = ([u0.floor() as i64, u1.ceil() as i64], [v0.floor() as i64, v1.ceil() as i64]);
            rows.extend((v[0]..v[1]).step_by(size[1] as usize).map(|at| Row { axis, plane, cells: u, at, size }));
        };
        match self.source {
            Source::Parallel(_) => {
                let (axis, slopes) = self.slopes();
                let [u, v] = beside(axis);
                let range = |a: usize, slope: f64| {
                    let shadow = -slope * self.n[axis];
                    [shadow.min(0.0), self.n[a] + shadow.max(0.0)]
                };
                add(axis, 0.0, range(u, slopes[0]), range(v, slopes[1]), [1, 1]);
            }
            Source::Point(p) => {
                for (axis, plane, _) in self.faces() {
                    let [u, v] = beside(axis);
                    let size = if sparse { self.spread(p, axis, plane) } else { [1, 1] };
                    add(axis, plane, [0.0, self.n[u]], [0.0, self.n[v]], size);
                }
            }
        }
        rows
    }

    /// How many cells of a face are a patch: a ray for each cell crosses at least so many voxels per layer of voxels as where
    /// it meets the face at the steepest.
    fn spread(&self, p: [f64; 3], axis: usize, plane: f64) -> [i64; 2] {
        let aside = |a: usize| (p[a].clamp(0.0, self.n[a]) - p[a]).abs();
        let crossed = 1.0 + beside(axis).map(aside).iter().sum::<f64>() / (plane - p[axis]).abs();
        if crossed > 1.7 { [2, 2] } else { [2, 1] }
    }

    /// Of parallel light the axis along which it crosses most voxels, and the voxels that it moves along the next two
    /// axes for each.
    fn slopes(&self) -> (usize, [f64; 2]) {
        let Source::Parallel(d) = self.source else { return (0, [0.0; 2]) };
        let speed: [f64; 3] = std::array::from_fn(|a| d[a] / self.h[a]);
        let axis = (1..3).fold(0, |most, a| if speed[a].abs() > speed[most].abs() { a } else { most });
        (axis, beside(axis).map(|a| speed[a] / speed[axis]))
    }

    /// The rays of a row of patches: `f(way, flux)`.
    #[inline(always)]
    pub fn over_row(&self, row: &Row, lattice: Lattice, shift: [f64; 2], f: &mut impl FnMut(&Way, f64)) {
        let [u, v] = beside(row.axis);
        let even = match self.source {
            // The solid angle of a patch, were all the same.
            Source::Point(_) => {
                let cells = |axis: usize| beside(axis).map(|a| self.n[a]).iter().product::<f64>();
                let patch = (row.size[0] * row.size[1]) as f64;
                patch * self.flux() / self.faces().iter().map(|face| cells(face.0)).sum::<f64>()
            }
            Source::Parallel(_) => 0.0,
        };
        let whole = self.n[v].min((row.at + row.size[1]) as f64);
        for cell in (row.cells[0]..row.cells[1]).step_by(row.size[0] as usize) {
            let low = [cell as f64, row.at as f64];
            let high = match self.source {
                Source::Point(_) => [self.n[u].min((cell + row.size[0]) as f64), whole],
                Source::Parallel(_) => low.map(|c| c + 1.0),
            };
            let patch = Patch { axis: row.axis, plane: row.plane, low, high };
            let (mut own, mut near) = (lattice, false);
            if let Source::Point(p) = self.source {
                let size = [(high[0] - low[0]) * self.h[u], (high[1] - low[1]) * self.h[v]];
                let r = [
                    (row.plane - p[row.axis]) * self.h[row.axis],
                    (0.5 * (low[0] + high[0]) - p[u]) * self.h[u],
                    (0.5 * (low[1] + high[1]) - p[v]) * self.h[v],
                ];
                let (d2, diagonal2) = (r.iter().map(|c| c * c).sum::<f64>(), size[0].powi(2) + size[1].powi(2));
                near = d2 < 64.0 * diagonal2;
                let seen = if near {
                    let rectangle = self.seen(&patch, p);
                    rectangle_solid_angle(rectangle.0[0], rectangle.0[1], rectangle.1[0], rectangle.1[1], rectangle.2)
                } else {
                    r[0].abs() * size[0] * size[1] / (d2 * d2.sqrt())
                };
                // Patches that catch much more light than others have more rays.
                if seen > 3.0 * even {
                    own = Lattice::of(lattice.points() as f64 * (seen / (3.0 * even)).min(MOST));
                }
            }
            self.over_patch(&patch, near, own, shift, |way, flux| {
                if let Some(way) = way {
                    f(&way, flux);
                }
            });
        }
    }

    /// A patch relative to a point light: its sides along both axes, and its distance.
    #[inline(always)]
    fn seen(&self, patch: &Patch, p: [f64; 3]) -> ([f64; 2], [f64; 2], f64) {
        let [u, v] = beside(patch.axis);
        let side = |a: usize, i: usize| [patch.low[i], patch.high[i]].map(|c| (c - p[a]) * self.h[a]);
        (side(u, 0), side(v, 1), ((patch.plane - p[patch.axis]) * self.h[patch.axis]).abs())
    }

    /// The rays of a patch, those that miss the box without a way. The points of a `near` one are even in solid angle.
    #[inline(always)]
    fn over_patch(
        &self,
        patch: &Patch,
        near: bool,
        lattice: Lattice,
        shift: [f64; 2],
        mut f: impl FnMut(Option<Way>, f64),
    ) {
        let axis = patch.axis;
        let [u, v] = beside(axis);
        let size = [patch.high[0] - patch.low[0], patch.high[1] - patch.low[1]];
        let share = 1.0 / lattice.points() as f64;
        let area = size[0] * self.h[u] * size[1] * self.h[v] * share;
        let mut target = [0.0; 3];
        target[axis] = patch.plane;
        match self.source {
            Source::Parallel(d) => {
                let (v3, flux) = (std::array::from_fn(|a| d[a] / self.h[a]), d[axis].abs() * area);
                lattice.each(shift, |x, y| {
                    target[u] = patch.low[0] + x * size[0];
                    target[v] = patch.low[1] + y * size[1];
                    f(self.way(target, v3, f64::INFINITY), flux);
                });
            }
            Source::Point(p) => {
                let (xs, ys, z) = self.seen(patch, p);
                let toward = (patch.plane - p[axis]) * self.h[axis];
                let map = near.then(|| {
                    (SphericalRectangle::new(xs, ys, z), rectangle_solid_angle(xs[0], xs[1], ys[0], ys[1], z) * share)
                });
                lattice.each(shift, |x, y| {
                    let [x, y] = match &map {
                        Some((map, _)) => map.at(x, y),
                        None => [xs[0] + x * (xs[1] - xs[0]), ys[0] + y * (ys[1] - ys[0])],
                    };
                    let d2 = x * x + y * y + z * z;
                    let d = d2.sqrt();
                    target[u] = p[u] + x / self.h[u];
                    target[v] = p[v] + y / self.h[v];
                    let mut v3 = [0.0; 3];
                    v3[axis] = toward / (d * self.h[axis]);
                    v3[u] = x / (d * self.h[u]);
                    v3[v] = y / (d * self.h[v]);
                    f(self.way(target, v3, d), map.map_or(z * area / (d2 * d), |map| map.1));
                });
            }
        }
    }

    /// The way through the box of a ray through `target`, which begins so far before it.
    #[inline(always)]
    fn way(&self, target: [f64; 3], v: [f64; 3], before: f64) -> Option<Way> {
        let (enter, leave) = box_range(target, v, self.n)?;
        let start = enter.max(-before);
        let p = std::array::from_fn(|a| (target[a] + v[a] * start).clamp(0.0, self.n[a]));
        (leave > start).then_some(Way { p, v, length: leave - start })
    }
}

/// A row of patches of a plane, at which rays for the voxels are aimed.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    axis: usize,
    plane: f64,
    cells: [i64; 2],
    at: i64,
    /// Cells of a patch.
    size: [i64; 2],
}

/// The axes of a plane normal to an axis, x before y before z: that in which voxels are neighbours in memory comes first.
fn beside(axis: usize) -> [usize; 2] {
    [[1, 2], [0, 2], [0, 1]][axis]
}
