//! View rays in even steps of about a voxel, where that is as good as walking each cell.
//!
//! A sum over equal steps integrates a smooth function that vanishes at the ends far better than its order says: it only
//! confuses waves shorter than the step, and interpolation has hardly any. Samples are taken in batches: first all lookups,
//! then exponentials and phase functions in loops that become vector instructions.

use super::gather::{Ray, Sums, View, interpolate};
use super::light::{Illumination, Source};
use crate::physics::Real;
use crate::scene::field::{V3, along};
use rayon::prelude::*;

/// Step in voxels.
const STEP: f32 = 0.7;
/// Optical depth of a voxel beyond which cells are walked.
const DEEPEST: f64 = 0.25;
/// Largest change of the depth towards a light from step to step: the midpoint rule is then right to 1 % where light
/// comes in.
const LIT_DEPTH: f32 = 0.5;
/// A light nearer than this many steps to a ray is integrated by angle.
const NEAR: f32 = 8.0;
/// The isotropic phase function.
const ISOTROPIC: f32 = 0.25 * std::f32::consts::FRAC_1_PI;
/// Samples of a batch.
const B: usize = 16;
/// Largest number of nodes whose fields are packed.
const PACKED: usize = 1 << 22;

/// Density, J, column density and one more field at the nodes of the light grid, side by side: a lookup of all four then
/// reads eight vectors.
pub struct Packed {
    nodes: Vec<[f32; 4]>,
    extra: Extra,
}

/// The fourth field.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Extra {
    None,
    Source0,
    Albedo,
}

impl Packed {
    /// Packs the fields of a grey scene with at most one light, which must interpolate its columns, if `samples` lookups are
    /// worth it.
    pub fn new<const C: usize, const S: usize>(view: &View<C, S>, samples: f64) -> Option<Self> {
        let volumes = view.volumes;
        let n = view.field.n().map(|m| m as usize);
        let nodes = n.map(|m| m + 2);
        let count = nodes[0] * nodes[1] * nodes[2];
        if C != 1 || S != 1 || volumes.lights.len() > 1 || samples < count as f64 || count > PACKED {
            return None;
        }
        let columns = match volumes.lights.first() {
            Some(light) if !light.is_fine() => light.nodes()?,
            _ => &[],
        };
        let albedo = view.albedo.as_ref();
        let extra = match (volumes.source0, albedo) {
            (Some(_), Some(_)) => return None,
            (Some(_), None) => Extra::Source0,
            (None, Some(_)) => Extra::Albedo,
            (None, None) => Extra::None,
        };
        let mut packed = vec![[0.0f32; 4]; count];
        packed.par_chunks_mut(nodes[0]).enumerate().for_each(|(row, out)| {
            let (j, k) = (row % nodes[1], row / nodes[1]);
            let y = j as f32 - 0.5;
            let z = k as f32 - 0.5;
            let inside = (1..=n[1]).contains(&j) && (1..=n[2]).contains(&k);
            for (i, node) in out.iter_mut().enumerate() {
                let p = [i as f32 - 0.5, y, z];
                let voxel = [i, j, k];
                let voxel: [i32; 3] = std::array::from_fn(|a| (voxel[a].clamp(1, n[a]) - 1) as i32);
                let whole = inside && (1..=n[0]).contains(&i);
                // Beyond the outermost centres J goes on along the line through the last two.
                let linear = |values: Option<&[f32]>| match values {
                    Some(values) if whole => values[view.field.index(voxel)],
                    Some(values) => interpolate::<1>(values, view.field.n(), p)[0],
                    None => 0.0,
                };
                let extra = match extra {
                    Extra::Source0 => linear(volumes.source0),
                    Extra::Albedo => albedo.map_or(1.0, |a| a.voxel(voxel)),
                    Extra::None => 0.0,
                };
                let column = columns.get(row * nodes[0] + i).copied().unwrap_or(0.0);
                *node = [view.field.voxel(voxel), linear(volumes.source), column, extra];
            }
        });
        Some(Packed { nodes: packed, extra })
    }

    /// All four fields at a point.
    #[inline(always)]
    fn at(&self, n: [i32; 3], p: V3) -> [f32; 4] {
        let q: V3 = std::array::from_fn(|a| Real::min(Real::max(p[a] + 0.5, 0.0), n[a] as f32 + 0.99));
        let cell = q.map(|c| c as i32 as usize);
        let u: V3 = std::array::from_fn(|a| q[a] - cell[a] as f32);
        let (row, slice) = (n[0] as usize + 2, (n[0] as usize + 2) * (n[1] as usize + 2));
        let base = cell[2] * slice + cell[1] * row + cell[0];
        // Neighbours along x lie side by side: both are interpolated along y and z at once.
        let pair = |at: usize| -> &[f32; 8] {
            let two: &[[f32; 4]; 2] = self.nodes[at..].first_chunk().unwrap_or(&[[0.0; 4]; 2]);
            two.as_flattened().first_chunk().unwrap_or(&[0.0; 8])
        };
        let low = lerp(u[1], pair(base), pair(base + row));
        let high = lerp(u[1], pair(base + slice), pair(base + slice + row));
        let line = lerp(u[2], &low, &high);
        let [x0, x1]: [[f32; 4]; 2] = [0, 4].map(|from| std::array::from_fn(|i| line[from + i]));
        lerp(u[0], &x0, &x1)
    }
}

#[inline(always)]
fn lerp<const N: usize>(u: f32, a: &[f32; N], b: &[f32; N]) -> [f32; N] {
    let mut between = [0.0; N];
    for i in 0..N {
        between[i] = a[i] + u * (b[i] - a[i]);
    }
    between
}

/// What one batch of samples reads.
struct Samples<const C: usize> {
    p: [V3; B],
    density: [f32; B],
    column: [f32; B],
    source: [f32; B],
    extra: [f32; B],
    /// sigma_s * length * transmittance.
    factor: [[f32; B]; C],
}

/// Whether rays through a volume whose voxels have the given optical depth may take even steps.
pub fn suits(depth: f64, linear: bool, constant: bool) -> bool {
    linear && !constant && depth <= DEEPEST
}

impl<const C: usize, const S: usize> View<'_, C, S> {
    /// Steps per unit of length along a ray.
    #[inline(always)]
    fn steps_per_length(&self, ray: &Ray) -> f32 {
        let v = ray.v;
        (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt() / STEP
    }

    /// Whether a point light is so close to a ray that its 1/d^2 changes much within a step.
    #[inline(always)]
    pub fn passes_light(&self, ray: &Ray) -> bool {
        let step = 1.0 / self.steps_per_length(ray);
        self.volumes.lights.iter().any(|light| {
            let Source::Point(position) = light.source else { return false };
            let to: V3 = std::array::from_fn(|a| (position[a] - ray.p[a]) * self.h[a] as f32);
            let foot = (0..3).map(|a| to[a] * ray.direction[a]).sum::<f32>().clamp(0.0, ray.length);
            let off2 = (0..3).map(|a| (to[a] - foot * ray.direction[a]).powi(2)).sum::<f32>();
            let reach = NEAR * step.max(self.h.iter().fold(0.0f64, |m, &h| m.max(h)) as f32);
            off2 < reach * reach
        })
    }

    /// Sums along one ray in even steps; `None` where the depth towards a light changes too much within one.
    #[inline(always)]
    pub fn even(&self, ray: &Ray) -> Option<Sums<C, S>> {
        let mut sums = Sums { order1: [0.0; C], source: [0.0; S], column: 0.0 };
        let per_length = self.steps_per_length(ray);
        let mut smooth = true;
        self.field.runs(ray.p, ray.v, ray.length, |t0, t1| {
            let steps = (((t1 - t0) * per_length).ceil() as usize).max(1);
            let step = (t1 - t0) / steps as f32;
            let mut from = 0;
            while from < steps {
                smooth &= self.batch(&mut sums, ray, t0 + step * from as f32, step, B.min(steps - from));
                from += B;
                if !smooth || sums.column * self.least_extinction > super::gather::OPAQUE {
                    return false;
                }
            }
            true
        });
        smooth.then_some(sums)
    }

    /// Adds `count` steps from `start` on; false if the depth towards a light changes too much between two of them.
    #[inline(always)]
    fn batch(&self, sums: &mut Sums<C, S>, ray: &Ray, start: f32, step: f32, count: usize) -> bool {
        let n = self.field.n();
        let mut s = Samples::<C> {
            p: [[0.0; 3]; B],
            density: [0.0; B],
            column: [0.0; B],
            source: [0.0; B],
            extra: [0.0; B],
            factor: [[0.0; B]; C],
        };
        for i in 0..B {
            s.p[i] = along(ray.p, ray.v, start + step * (i as f32 + 0.5));
        }
        let packed = self.packed.as_ref();
        match packed {
            Some(packed) => {
                let mut fields = [[0.0f32; 4]; B];
                for i in 0..count {
                    fields[i] = packed.at(n, s.p[i]);
                }
                for i in 0..B {
                    [s.density[i], s.source[i], s.column[i], s.extra[i]] = fields[i];
                }
            }
            None => {
                for i in 0..count {
                    s.density[i] = self.field.at(s.p[i]);
                }
            }
        }
        let mut through = [0.0f32; B];
        for i in 0..B {
            through[i] = sums.column + 0.5 * step * s.density[i];
            sums.column += step * s.density[i];
        }
        let mut albedo = [1.0f32; B];
        match (packed, &self.albedo) {
            (Some(_), Some(_)) => albedo = s.extra,
            (None, Some(field)) => (0..count).for_each(|i| albedo[i] = field.at(s.p[i])),
            _ => {}
        }
        for c in 0..C {
            let scale = self.extinction[c] * self.constant_albedo[c] * step;
            for i in 0..B {
                let depth = self.extinction[c] * s.density[i] * step;
                // The mean of exp(-depth) over the step, to third order, over its value in the middle.
                let mean = 1.0 + depth * depth * (1.0 / 24.0);
                s.factor[c][i] = scale * mean * albedo[i] * s.density[i] * Real::exp(-self.extinction[c] * through[i]);
            }
        }
        let mut smooth = true;
        for light in &self.volumes.lights {
            if packed.is_none() || light.is_fine() {
                for i in 0..count {
                    s.column[i] = if s.density[i] > 0.0 { light.column_at(s.p[i]) } else { 0.0 };
                }
            }
            // Where there is nothing it does not matter.
            let there = |i: usize| s.density[i] + s.density[i - 1] > 0.0;
            smooth &= !(1..count).any(|i| there(i) && self.is_steep([s.column[i - 1], s.column[i]], LIT_DEPTH));
            self.lit_batch(&mut sums.order1, &s, light, ray.direction);
        }
        self.volume_batch(sums, &s, count);
        smooth
    }

    /// Adds a light's order 1.
    #[inline(always)]
    fn lit_batch(&self, order1: &mut [f32; C], s: &Samples<C>, light: &Illumination, view: V3) {
        let mut scattered = [0.0f32; B];
        if self.isotropic {
            for i in 0..B {
                scattered[i] = light.falloff(s.p[i]) * ISOTROPIC;
            }
        } else {
            for i in 0..B {
                let incident = light.incident(s.p[i]);
                scattered[i] = incident.falloff * self.toward_eye(&incident.direction, &view);
            }
        }
        for c in 0..C {
            let mut terms = [0.0f32; B];
            for i in 0..B {
                terms[i] = s.factor[c][i] * scattered[i] * Real::exp(-self.extinction[c] * Real::max(s.column[i], 0.0));
            }
            order1[c] += light.value[c] * sum(&terms);
        }
    }

    /// Adds what the volumes hold.
    #[inline(always)]
    fn volume_batch(&self, sums: &mut Sums<C, S>, s: &Samples<C>, count: usize) {
        if let Some(packed) = &self.packed {
            let weighted = |j: &[f32; B]| sum(&std::array::from_fn(|i| s.factor[0][i] * j[i]));
            sums.source[0] += weighted(&s.source);
            if packed.extra == Extra::Source0 {
                sums.order1[0] += weighted(&s.extra);
            }
            return;
        }
        let factor = |i: usize| -> [f32; C] { std::array::from_fn(|c| s.factor[c][i]) };
        for i in 0..count {
            if s.density[i] > 0.0 {
                self.volume_terms(sums, s.p[i], &factor(i));
            }
        }
    }
}

/// The sum of a batch, in four parts.
#[inline(always)]
fn sum(terms: &[f32; B]) -> f32 {
    let mut four = [0.0f32; 4];
    for i in 0..B / 4 {
        for k in 0..4 {
            four[k] += terms[4 * i + k];
        }
    }
    (four[0] + four[2]) + (four[1] + four[3])
}

#[cfg(test)]
mod tests {
    use super::super::gather::{Image, Volumes, look};
    use super::super::light::Illumination;
    use super::*;
    use crate::backend::Control;
    use crate::physics::Phase;
    use crate::plan::Column;
    use crate::scene::field::Occupancy;
    use crate::scene::{Albedo, Camera, Light, Medium, Scene, Spectrum, Volume};

    const N: [usize; 3] = [40, 33, 28];

    /// A value for each voxel.
    fn field(value: impl Fn(V3) -> f32) -> Vec<f32> {
        (0..N[0] * N[1] * N[2])
            .map(|at| value([at % N[0], at / N[0] % N[1], at / (N[0] * N[1])].map(|c| c as f32)))
            .collect()
    }

    /// Bumps in a ball, with empty blocks around it.
    fn bumps() -> Vec<f32> {
        field(|p| {
            let r = (0..3).map(|a| (p[a] - 0.5 * N[a] as f32).powi(2)).sum::<f32>().sqrt();
            let bump = 1.0 + (0.9 * p[0]).sin() * (0.7 * p[1] + 1.0).cos() * (0.8 * p[2]).sin();
            bump * (0.5 * (13.0 - r)).clamp(0.0, 1.0)
        })
    }

    /// The image in even steps, and that cell by cell.
    fn both<const C: usize, const S: usize>(phase: Phase, per_voxel: bool, lights: &[Light]) -> [Image; 2] {
        let density = bumps();
        let albedo = field(|p| 0.5 + 0.4 * (0.3 * p[0] + 0.2 * p[1]).sin());
        let source = field(|p| 2.0 + (0.2 * p[0] + 0.3 * p[2]).cos());
        let source: Vec<f32> = source.iter().flat_map(|j| (0..S).map(move |s| j * (1.0 + s as f32))).collect();
        let volume = Volume::new(&density, N, [1.0, 1.2, 0.8], [0.0; 3], true).expect("valid");
        let spectrum = |v: [f64; 3]| Spectrum::new(&v[..C], "value").expect("valid");
        let albedo = if per_voxel { Albedo::PerVoxel(&albedo) } else { Albedo::Constant(spectrum([0.9, 0.8, 0.7])) };
        let medium = Medium::new(volume, spectrum([0.1, 0.08, 0.05]), albedo, phase).expect("valid");
        let eye = [90.0, -60.0, 40.0];
        let camera = Camera::perspective(eye, [20.0, 20.0, 11.0], [0.0, 0.0, 1.0], 30.0, [48, 40]).expect("valid");
        let scene = Scene::new(medium, lights.to_vec(), camera);
        let occupancy = Occupancy::new(&scene.medium.volume);
        let occupancy = occupancy.as_ref();
        assert!(occupancy.is_some());
        let view =
            |light, how, nodes| Illumination::new(&scene, occupancy, light, how, nodes).expect("has a direction");
        let grids: Vec<Vec<f32>> =
            lights.iter().map(|light| view(light, Column::Rays, None).columns(&Control::new(None))).collect();
        let lights = lights.iter().zip(&grids).map(|(light, grid)| view(light, Column::Grid, Some(grid))).collect();
        let volumes = Volumes { scene: &scene, occupancy, lights, source: Some(&source), source0: None, channels: C };
        [true, false].map(|even| {
            let mut view = View::<C, S>::new(&volumes);
            assert!(view.even);
            view.even = even;
            look(view, &camera, None, &|| false)
        })
    }

    /// The root mean square difference of two layers over the mean of the second.
    fn difference(layers: [&[f32]; 2]) -> f64 {
        let [a, b] = layers;
        let square = a.iter().zip(b).map(|(x, y)| f64::from(x - y).powi(2)).sum::<f64>() / a.len() as f64;
        square.sqrt() / (b.iter().map(|&y| f64::from(y)).sum::<f64>() / b.len() as f64).max(1e-30)
    }

    fn agree([even, exact]: [Image; 2]) {
        for (layer, layers) in [
            ("order 1", [&even.order1, &exact.order1]),
            ("orders >= 2", [&even.order2, &exact.order2]),
            ("transmittance", [&even.transmittance, &exact.transmittance]),
        ] {
            let difference = difference(layers.map(Vec::as_slice));
            assert!(difference < 3e-3, "{layer}: {difference}");
        }
    }

    fn point(position: [f64; 3]) -> Light {
        Light::point(position, &[1e3]).expect("valid")
    }

    #[test]
    fn even_steps_see_what_cells_show() {
        agree(both::<1, 1>(Phase::Isotropic, false, &[point([80.0, -50.0, 90.0])]));
    }

    #[test]
    fn even_steps_see_phase_functions_and_albedos_per_voxel() {
        agree(both::<1, 1>(Phase::henyey_greenstein(0.8).expect("valid"), true, &[point([80.0, -50.0, 90.0])]));
    }

    #[test]
    fn even_steps_see_replicates_colours_and_several_lights() {
        let parallel = Light::directional([-1.0, 0.2, -0.5], &[1.0]).expect("valid");
        agree(both::<1, 8>(Phase::Isotropic, true, &[]));
        agree(both::<3, 3>(Phase::Isotropic, false, &[parallel.clone(), point([80.0, -50.0, 90.0])]));
        agree(both::<3, 24>(Phase::Rayleigh, false, &[parallel]));
    }

    #[test]
    fn even_steps_leave_rays_beside_a_light_to_the_cells() {
        agree(both::<1, 1>(Phase::Isotropic, false, &[point([20.2, 19.1, 12.3])]));
    }
}
