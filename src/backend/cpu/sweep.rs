//! The light grid by long characteristics: rays from the light are swept through the volume from plane to plane of voxel
//! centres, each with its own running column density, which is interpolated sideways at the centres.
//!
//! A ray crosses each plane once, and in every plane the rays stand on a regular lattice (their positions are affine in
//! their numbers), so that the density is read for all of them by one resampling along each axis: O(N^3) in all, where a
//! ray to every voxel would take O(N^4).

mod lattice;
mod sheet;

use super::light::{GAUSS, Source};
use crate::backend::Control;
use crate::scene::field::{Field, V3};
use lattice::{Lattice, Tap};
use rayon::prelude::*;
use sheet::Sheet;

/// Steepest slope, in voxels across per voxel along, at which one sweep holds all rays; beyond, each axis has its own.
const STEEPEST: f64 = 2.0;
/// Planes between two meetings of all threads.
const GROUP: usize = 16;
/// Rows of rays that a thread takes at once.
const ROWS: usize = 8;
/// Readings of constant voxels in each half of the way between two planes.
const STEPS: usize = 2;

/// The column densities between a light and the nodes of `field` (see [`super::light::Illumination::columns`]).
pub fn columns(field: &Field, h: V3, source: Source, control: &Control) -> Vec<f32> {
    let n = field.n();
    let nodes = n.map(|m| m as usize + 2);
    let mut columns = vec![0.0f32; nodes[0] * nodes[1] * nodes[2]];
    // Parallel light has its slopes in voxels.
    let source = match source {
        Source::Point(_) => source,
        Source::Directional(d) => Source::Directional(std::array::from_fn(|a| d[a] / h[a])),
    };
    for sector in sectors(n, source) {
        if let Some(sweep) = Sweep::new(field, h, source, sector) {
            sweep.run(&mut columns, control);
        }
    }
    reflect(&mut columns, nodes, source);
    columns
}

/// Where light comes in the column is zero on the face: nodes beyond have those before with the sign reversed.
fn reflect(columns: &mut [f32], nodes: [usize; 3], source: Source) {
    for axis in 0..3 {
        let lit = match source {
            Source::Directional(v) if v[axis] > 0.0 => Some((0, 1)),
            Source::Directional(v) if v[axis] < 0.0 => Some((nodes[axis] - 1, nodes[axis] - 2)),
            Source::Point(p) if p[axis] < 0.0 => Some((0, 1)),
            Source::Point(p) if p[axis] > nodes[axis] as f32 - 2.0 => Some((nodes[axis] - 1, nodes[axis] - 2)),
            _ => None,
        };
        let Some((to, from)) = lit else { continue };
        let stride = [1, nodes[0], nodes[0] * nodes[1]];
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for i in 0..nodes[u] {
            for j in 0..nodes[v] {
                let base = i * stride[u] + j * stride[v];
                columns[base + to * stride[axis]] = -columns[base + from * stride[axis]];
            }
        }
    }
}

/// Light that travels mainly along one axis.
#[derive(Debug, Clone, Copy)]
struct Sector {
    axis: usize,
    forward: bool,
    /// Largest slope of the nodes' rays.
    limit: f64,
}

/// One sector if no ray is too steep in it; else all six, of which those without a node fall away.
fn sectors(n: [i32; 3], source: Source) -> Vec<Sector> {
    match source {
        Source::Directional(v) => {
            let axis = (0..3).max_by(|&a, &b| v[a].abs().total_cmp(&v[b].abs())).unwrap_or(2);
            vec![Sector { axis, forward: v[axis] > 0.0, limit: f64::INFINITY }]
        }
        Source::Point(p) => {
            let p = p.map(f64::from);
            let reach = |a: usize| (p[a] + 0.5).abs().max((f64::from(n[a]) + 0.5 - p[a]).abs());
            let steepest = |axis: usize| {
                let away = (-0.5 - p[axis]).max(p[axis] - f64::from(n[axis]) - 0.5);
                if away > 0.0 { reach((axis + 1) % 3).max(reach((axis + 2) % 3)) / away } else { f64::INFINITY }
            };
            let axis = (0..3).min_by(|&a, &b| steepest(a).total_cmp(&steepest(b))).unwrap_or(2);
            if steepest(axis) <= STEEPEST {
                return vec![Sector { axis, forward: p[axis] < 0.0, limit: f64::INFINITY }];
            }
            (0..6).map(|at| Sector { axis: at / 2, forward: at % 2 == 1, limit: 1.0 }).collect()
        }
    }
}

/// Where the density is read between two planes, and with what weight: two Gauss points in each half, which is exact in a
/// cell of interpolation; in voxels of constant density points equally spaced, up to a face and from it.
fn places(w0: f64, w1: f64, linear: bool) -> Vec<(f64, f64)> {
    let rule: Vec<(f64, f64)> = if linear {
        GAUSS[1].to_vec()
    } else {
        (0..STEPS).map(|i| ((i as f64 + 0.5) / STEPS as f64, 1.0 / STEPS as f64)).collect()
    };
    let middle = (w1 - 0.5).clamp(w0.min(w1), w0.max(w1));
    let piece = |(from, to): (f64, f64)| {
        let rule = rule.clone();
        rule.into_iter().map(move |(x, weight)| (from + x * (to - from), weight * (to - from)))
    };
    [(w0, middle), (middle, w1)].into_iter().filter(|(a, b)| a != b).flat_map(piece).collect()
}

/// One reading of the density on the way from a plane to the next: at `w`, between two planes of voxels.
struct Reading {
    planes: [usize; 2],
    upper: f32,
    weight: f32,
    u: (Vec<u32>, Vec<f32>),
    v: (Vec<u32>, Vec<f32>),
}

/// The way of all rays from the plane `w0` to the plane of nodes `w1`.
struct Slab {
    /// The plane of nodes at its end, and where it lies.
    node: usize,
    w: f64,
    active: [(usize, usize); 2],
    way_in: [Vec<f32>; 2],
    /// The medium that a ray outside can have been in, at most.
    most: f32,
    readings: Vec<Reading>,
    taps: [Vec<Option<Tap>>; 2],
}

/// The rays of one sector. Along the light's axis `w` runs with the light.
struct Sweep<'a> {
    field: &'a Field<'a>,
    h: V3,
    source: Source,
    sector: Sector,
    /// The axes across: u is the faster in memory.
    across: [usize; 2],
    lattice: [Lattice; 2],
    /// Extent along the axis, and where the rays start.
    depth: usize,
    light: Option<[f64; 3]>,
    start: f64,
}

impl<'a> Sweep<'a> {
    fn new(field: &'a Field, h: V3, source: Source, sector: Sector) -> Option<Self> {
        let n = field.n().map(|m| m as usize);
        let across = [[1, 2], [0, 2], [0, 1]][sector.axis];
        let depth = n[sector.axis];
        let end = depth as f64 + 0.5;
        let (light, start, lattice) = match source {
            Source::Directional(v) => {
                let slope = |a: usize| f64::from(v[a]) / f64::from(v[sector.axis].abs());
                (None, 0.0, across.map(|a| Some(Lattice::parallel(n[a], slope(a), end))))
            }
            Source::Point(p) => {
                let p = p.map(f64::from);
                let along = if sector.forward { p[sector.axis] } else { depth as f64 - p[sector.axis] };
                if along >= end {
                    return None;
                }
                let first = (along + 0.5).ceil().max(0.0) - 0.5;
                let lattice = |a: usize| Lattice::from_point(n[a], p[a], along, (first, end), sector.limit);
                (Some([p[across[0]], p[across[1]], along]), along.max(0.0), across.map(lattice))
            }
        };
        let [u, v] = lattice;
        Some(Sweep { field, h, source, sector, across, lattice: [u?, v?], depth, light, start })
    }

    fn run(&self, columns: &mut [f32], control: &Control) {
        let n = self.field.n().map(|m| m as usize + 2);
        let count = self.lattice.map(|l| l.count);
        let row = count[0] * (GROUP + 1);
        // For each row of rays the running columns at the group's planes, the first being the last of the group before.
        let mut rays = vec![0.0f32; count[1] * row];
        let planes: Vec<usize> = (0..self.depth + 2).filter(|&k| self.plane(k) > self.light_plane()).collect();
        let mut before = self.start;
        for group in planes.chunks(GROUP) {
            if control.stopped() {
                return;
            }
            let slabs: Vec<Slab> = group
                .iter()
                .map(|&node| {
                    let slab = self.slab(node, before);
                    before = slab.w;
                    slab
                })
                .collect();
            rays.par_chunks_mut(ROWS * row)
                .enumerate()
                .for_each(|(chunk, rows)| self.advance(chunk * ROWS, rows, &slabs));
            columns.par_chunks_mut(n[0] * n[1]).enumerate().for_each(|(z, out)| self.write(z, out, &slabs, &rays));
            rays.par_chunks_mut(row).for_each(|row| {
                row.copy_within(group.len() * count[0]..(group.len() + 1) * count[0], 0);
            });
        }
    }

    fn plane(&self, node: usize) -> f64 {
        node as f64 - 0.5
    }

    /// Where the light stands on the axis.
    fn light_plane(&self) -> f64 {
        self.light.map_or(f64::NEG_INFINITY, |p| p[2])
    }

    fn slab(&self, node: usize, w0: f64) -> Slab {
        let w1 = self.plane(node);
        let [u, v] = &self.lattice;
        let last = self.depth - 1;
        // Within half a voxel of the faces the density is that of the outermost plane. The nodes before the box have
        // their way to it with the sign reversed.
        let low = node.max(1) - 1;
        let planes = [low.max(1) - 1, low.min(last)];
        let linear = self.field.linear();
        let reading = |(w, weight): (f64, f64)| {
            let upper = (w - (w1 - 1.0)).clamp(0.0, 1.0) as f32;
            let upper = if linear { upper } else { upper.round() };
            Reading { planes, upper, weight: weight as f32, u: u.cells(w, linear), v: v.cells(w, linear) }
        };
        let readings = places(w0, w1, linear).into_iter().map(reading).collect();
        let mine = |across: usize| {
            let (light, limit) = (self.light, self.sector.limit);
            move |x: f64| light.is_none_or(|p| (x - p[across]).abs() <= limit * (w1 - p[2]))
        };
        Slab {
            node: if self.sector.forward { node } else { self.depth + 1 - node },
            w: w1,
            active: [u.active(w0.min(w1), w0.max(w1)), v.active(w0.min(w1), w0.max(w1))],
            way_in: [u.way_in(w0), v.way_in(w0)],
            most: (w0 - self.start).max(1.0) as f32,
            readings,
            taps: [u.taps(w1, mine(0)), v.taps(w1, mine(1))],
        }
    }

    /// Carries rows of rays, from number `first` on, through the slabs.
    fn advance(&self, first: usize, rows: &mut [f32], slabs: &[Slab]) {
        let count = self.lattice[0].count;
        let mut sheet = Sheet::new(self, count);
        for (g, slab) in slabs.iter().enumerate() {
            let (i0, i1) = slab.active[0];
            if i0 >= i1 {
                continue;
            }
            for (at, reading) in slab.readings.iter().enumerate() {
                sheet.clear();
                for (j, row) in rows.chunks_mut(count * (GROUP + 1)).enumerate() {
                    let j = first + j;
                    if j < slab.active[1].0 || j >= slab.active[1].1 {
                        continue;
                    }
                    let (before, after) = row[g * count..(g + 2) * count].split_at_mut(count);
                    let density = sheet.row(self, reading, j, (i0, i1));
                    if at == 0 {
                        // A ray that is yet to come in has its way to the box with the sign reversed, so that the column
                        // is smooth across the face.
                        let (way_u, way_v) = (&slab.way_in[0], slab.way_in[1][j]);
                        for i in i0..i1 {
                            let way = way_u[i].max(way_v);
                            let start = if way > 0.0 { -density[i] * way.min(slab.most) } else { before[i] };
                            after[i] = start + reading.weight * density[i];
                        }
                    } else {
                        for i in i0..i1 {
                            after[i] += reading.weight * density[i];
                        }
                    }
                }
            }
        }
    }

    /// Interpolates between the rays at the nodes of slice `z`, as far as the slabs end in it.
    fn write(&self, z: usize, out: &mut [f32], slabs: &[Slab], rays: &[f32]) {
        let n = self.field.n().map(|m| m as usize + 2);
        let count = self.lattice[0].count;
        let stride = if self.sector.axis == 0 { n[0] } else { 1 };
        let mut line = vec![0.0f32; count];
        for (g, slab) in slabs.iter().enumerate() {
            let rows = match self.sector.axis {
                2 if slab.node != z => continue,
                2 => 0..n[1],
                _ => z..z + 1,
            };
            let (i0, i1) = slab.active[0];
            for v in rows {
                let Some((j, weights)) = slab.taps[1][v] else { continue };
                let ray = |tap: usize| &rays[((j + tap) * (GROUP + 1) + g + 1) * count..][..count];
                let (a, b, c, d) = (ray(0), ray(1), ray(2), ray(3));
                for i in i0..i1 {
                    line[i] = weights[0] * a[i] + weights[1] * b[i] + weights[2] * c[i] + weights[3] * d[i];
                }
                let base = match self.sector.axis {
                    0 => slab.node,
                    1 => slab.node * n[0],
                    _ => v * n[0],
                };
                let scale = self.scale(v as f64 - 0.5, slab.w);
                for (u, tap) in slab.taps[0].iter().enumerate() {
                    let Some((i, weights)) = tap else { continue };
                    let sum = (0..4).map(|t| weights[t] * line[i + t]).sum::<f32>();
                    out[base + u * stride] = sum.max(0.0) * scale(u as f64 - 0.5);
                }
            }
        }
    }

    /// The length of a ray to the node (u, v) in the plane `w` over its extent along the axis.
    fn scale(&self, v: f64, w: f64) -> impl Fn(f64) -> f32 {
        let h = [self.across[0], self.across[1], self.sector.axis].map(|a| f64::from(self.h[a]));
        let axis = [self.across[0], self.across[1], self.sector.axis];
        let (light, source) = (self.light, self.source);
        move |u: f64| {
            let way = match (light, source) {
                (Some(p), _) => [u - p[0], v - p[1], w - p[2]],
                (None, Source::Directional(d)) | (None, Source::Point(d)) => axis.map(|a| f64::from(d[a])),
            };
            let length = (0..3).map(|a| (way[a] * h[a]).powi(2)).sum::<f64>().sqrt();
            (length / way[2].abs()) as f32
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::light::Illumination;
    use super::*;
    use crate::plan::Column;
    use crate::scene::{Albedo, Camera, Light, Medium, Scene, Spectrum, Volume};

    const N: [usize; 3] = [22, 17, 26];

    fn point(position: [f64; 3]) -> Light {
        Light::point(position, &[1.0]).expect("valid")
    }

    fn parallel(direction: [f64; 3]) -> Light {
        Light::directional(direction, &[1.0]).expect("valid")
    }

    /// Light from all sides: one sweep, six, grazing, along an axis.
    fn lights() -> Vec<Light> {
        vec![
            point([40.0, -30.0, 60.0]),
            point([-20.0, 7.0, 9.0]),
            point([9.3, 12.1, 20.2]),
            point([4.0, 10.0, -1.0]),
            parallel([0.0, 0.0, -1.0]),
            parallel([1.0, 0.9, 0.8]),
            parallel([-0.3, 1.0, 0.25]),
        ]
    }

    /// Bumps between 0 and 2 that reach the faces.
    fn bumps() -> Vec<f32> {
        (0..N[0] * N[1] * N[2])
            .map(|at| {
                let p = [at % N[0], at / N[0] % N[1], at / (N[0] * N[1])].map(|c| c as f32);
                1.0 + (0.7 * p[0]).sin() * (0.5 * p[1] + 1.0).cos() * (0.6 * p[2]).sin()
            })
            .collect()
    }

    /// The root mean square error of the transmittance at the centres, and the largest of a column on a lit face.
    fn error(density: &[f32], linear: bool, light: &Light) -> (f64, f32) {
        let volume = Volume::new(density, N, [1.0, 1.5, 0.75], [0.0; 3], linear).expect("valid");
        let grey = |v: f64| Spectrum::new(&[v], "value").expect("valid");
        let phase = crate::physics::Phase::Isotropic;
        let medium = Medium::new(volume, grey(0.1), Albedo::Constant(grey(0.9)), phase).expect("valid");
        let camera = Camera::perspective([90.0; 3], [9.0; 3], [0.0, 0.0, 1.0], 20.0, [9, 9]).expect("valid");
        let scene = Scene::new(medium, vec![light.clone()], camera);
        let rays = Illumination::new(&scene, None, light, Column::Rays, None).expect("has a direction");
        let nodes = rays.columns(&Control::new(None));
        let grid = Illumination::new(&scene, None, light, Column::Grid, Some(&nodes)).expect("has a direction");
        let (mut sum, mut face) = (0.0, 0.0f32);
        for at in 0..density.len() {
            let p = [at % N[0], at / N[0] % N[1], at / (N[0] * N[1])].map(|c| c as f32 + 0.5);
            let incident = rays.incident(p);
            let [exact, swept] = [rays.ray(p, &incident), grid.rough_column(p, &incident)];
            sum += f64::from((-0.1 * exact).exp() - (-0.1 * swept).exp()).powi(2);
            for a in 0..3 {
                let mut q = p;
                q[a] = if incident.direction[a] > 0.0 { 0.0 } else { N[a] as f32 };
                let incident = rays.incident(q);
                if rays.ray(q, &incident) == 0.0 {
                    face = face.max(grid.rough_column(q, &incident));
                }
            }
        }
        ((sum / density.len() as f64).sqrt(), face)
    }

    #[test]
    fn sweep_agrees_with_a_ray_to_every_voxel() {
        for light in lights() {
            let (error, face) = error(&bumps(), true, &light);
            assert!(error < 4e-3, "{light:?}: {error}");
            assert!(face < 1e-4, "{light:?}: {face} on a face where the light comes in");
        }
    }

    #[test]
    fn sweep_through_constant_voxels_agrees_with_rays() {
        for light in lights() {
            let (error, _) = error(&bumps(), false, &light);
            assert!(error < 6e-3, "{light:?}: {error}");
        }
    }

    #[test]
    fn sweep_is_exact_in_constant_density_but_for_the_edges() {
        for light in lights() {
            let (error, _) = error(&vec![1.0; N[0] * N[1] * N[2]], true, &light);
            assert!(error < 4e-3, "{light:?}: {error}");
        }
    }

    /// Light that grazes a face has a kink within a voxel of it, which no grid resolves.
    #[test]
    fn sweep_of_grazing_light_errs_no_more_than_its_kink() {
        let (error, face) = error(&bumps(), true, &parallel([-0.3, 1.0, 0.02]));
        assert!(error < 1e-2 && face < 1e-4, "{error}, on the face {face}");
    }
}
