//! The gather: images from what the run left in the voxels, deterministic, front to back, for any camera.
//!
//! Along a view ray the source term is sigma_s * (order 1 + J): order 1 from the lights directly, J interpolated between
//! voxel centres. Rays through smooth volumes take even steps (the neighbour [`super::even`]); the others walk each cell
//! within which the density is one polynomial, cut into steps of at most half an optical depth with two Gauss points each.

mod backdrop;
mod close;
mod lit;
mod outline;
mod points;
mod samples;

use super::emitted::Glow;
use super::even::{Packed, suits};
use super::light::{GAUSS, Illumination};
use super::unscattered::{cosine, over_beam};
use crate::physics::Phase;
use crate::scene::eye::LocalEye;
use crate::scene::field::{Field, Occupancy, V3, along, between, local};
use crate::scene::{Albedo, Camera, Light, Scene, ViewRay};
pub use backdrop::Backdrop;
use close::{Profile, close_light};
pub use outline::Outline;
pub use points::{point, stride};
use rayon::prelude::*;
use samples::samples_per_axis;
#[cfg(feature = "gpu")]
pub use samples::{Rays, rays};

/// Largest optical depth of a step.
const STEP_DEPTH: f32 = 0.5;
/// Steps of a cell at most: so many resolve what is seen of a density that grows from zero to 10^7 mean free paths.
const MOST_STEPS: usize = 1 << 24;
/// A ray ends where its transmittance is below exp(-this).
pub(super) const OPAQUE: f32 = 12.0;

/// What the gather reads.
pub struct Volumes<'a> {
    /// The scene.
    pub scene: &'a Scene<'a>,
    /// Which blocks of voxels are not empty.
    pub occupancy: Option<&'a Occupancy>,
    /// Lights with a deterministic order 1.
    pub lights: Vec<Illumination<'a>>,
    /// J per voxel: `stride` values, the channel outermost.
    pub source: Option<&'a [f32]>,
    /// The part of J that belongs to order 1, `channels` values a voxel.
    pub source0: Option<&'a [f32]>,
    /// 1 or 3.
    pub channels: usize,
}

/// Layers of an image, row by row from the top, channels fastest.
#[derive(Debug, Clone, Default)]
pub struct Image {
    /// Light scattered once.
    pub order1: Vec<f32>,
    /// Light scattered more often (all replicates, if the source holds them).
    pub order2: Vec<f32>,
    /// Transmittance of the volume.
    pub transmittance: Vec<f32>,
    /// Light that the medium emitted, weakened but not scattered.
    pub emitted: Vec<f32>,
    /// The environment, seen through the volume.
    pub background: Vec<f32>,
}

/// One view ray's sums: `C` channels, `S` values of the source volume.
pub(super) struct Sums<const C: usize, const S: usize> {
    pub order1: [f32; C],
    pub source: [f32; S],
    pub column: f32,
}

/// The layers of all pixels, or of the given ones. What the medium emits and what lies behind it, which no photon has to do
/// with, are looked for if `whole`, and else stay zero.
pub fn image(
    volumes: &Volumes,
    camera: &Camera,
    pixels: Option<&[usize]>,
    stride: usize,
    whole: bool,
    stop: &(impl Fn() -> bool + Sync),
) -> Image {
    match (volumes.channels, stride) {
        (1, 1) => gather::<1, 1>(volumes, camera, pixels, whole, stop),
        (1, 8) => gather::<1, 8>(volumes, camera, pixels, whole, stop),
        (1, 16) => gather::<1, 16>(volumes, camera, pixels, whole, stop),
        (3, 3) => gather::<3, 3>(volumes, camera, pixels, whole, stop),
        (3, 24) => gather::<3, 24>(volumes, camera, pixels, whole, stop),
        (3, 48) => gather::<3, 48>(volumes, camera, pixels, whole, stop),
        _ => replicate_by_replicate(volumes, camera, pixels, stride, whole, stop),
    }
}

/// Any other number of replicates (a run stopped early, a merge): one after the other.
fn replicate_by_replicate(
    volumes: &Volumes,
    camera: &Camera,
    pixels: Option<&[usize]>,
    stride: usize,
    whole: bool,
    stop: &(impl Fn() -> bool + Sync),
) -> Image {
    let channels = volumes.channels;
    let k = stride / channels;
    let mut all = Image::default();
    for replicate in 0..k {
        let slice: Option<Vec<f32>> = volumes.source.map(|s| s.iter().skip(replicate).step_by(k).copied().collect());
        let part = Volumes {
            scene: volumes.scene,
            occupancy: volumes.occupancy,
            lights: if replicate == 0 { volumes.lights.clone() } else { Vec::new() },
            source: slice.as_deref(),
            source0: None,
            channels,
        };
        let one = image(&part, camera, pixels, channels, whole && replicate == 0, stop);
        if replicate == 0 {
            all = Image { order2: vec![0.0; one.order2.len() * k], ..one.clone() };
        }
        for (at, value) in one.order2.iter().enumerate() {
            all.order2[at * k + replicate] = *value;
        }
    }
    all
}

fn gather<const C: usize, const S: usize>(
    volumes: &Volumes,
    camera: &Camera,
    pixels: Option<&[usize]>,
    whole: bool,
    stop: &(impl Fn() -> bool + Sync),
) -> Image {
    let view = View::<C, S>::new(volumes);
    look(if whole { view.whole() } else { view }, camera, pixels, stop)
}

/// The image of a grey scene, or of one in three channels, with one replicate, cell by cell.
#[cfg(all(test, feature = "gpu"))]
pub fn by_cells(volumes: &Volumes, camera: &Camera, pixels: Option<&[usize]>) -> Image {
    fn with<const C: usize>(volumes: &Volumes, camera: &Camera, pixels: Option<&[usize]>) -> Image {
        look(View::<C, C> { even: false, ..View::new(volumes) }.whole(), camera, pixels, &|| false)
    }
    if volumes.channels == 1 { with::<1>(volumes, camera, pixels) } else { with::<3>(volumes, camera, pixels) }
}

/// Samples that the view rays of so many pixels take, about.
pub fn samples(scene: &Scene, camera: &Camera, pixels: usize) -> f64 {
    let rays = (pixels * samples_per_axis(scene, camera).pow(2)) as f64;
    rays * scene.medium.volume.n().iter().sum::<usize>() as f64 / 3.0
}

/// The image of a view.
pub(super) fn look<const C: usize, const S: usize>(
    mut view: View<C, S>,
    camera: &Camera,
    pixels: Option<&[usize]>,
    stop: &(impl Fn() -> bool + Sync),
) -> Image {
    let [width, height] = camera.resolution;
    let count = pixels.map_or(width * height, <[usize]>::len);
    let mut image = Image {
        order1: vec![0.0; count * C],
        order2: vec![0.0; count * S],
        transmittance: vec![1.0; count * C],
        emitted: vec![0.0; count * C],
        background: vec![0.0; count * C],
    };
    let fine = samples_per_axis(view.volumes.scene, camera);
    if view.even {
        view.packed = Packed::new(&view, samples(view.volumes.scene, camera, count));
    }
    let outline = Outline::new(view.volumes.scene, camera);
    // Tiles along a row: neighbouring pixels read the same voxels.
    const TILE: usize = 32;
    image
        .order1
        .par_chunks_mut(TILE * C)
        .zip(image.order2.par_chunks_mut(TILE * S))
        .zip(image.transmittance.par_chunks_mut(TILE * C))
        .zip(image.emitted.par_chunks_mut(TILE * C).zip(image.background.par_chunks_mut(TILE * C)))
        .enumerate()
        .for_each(|(tile, (((order1, order2), transmittance), (emitted, background)))| {
            if stop() {
                return;
            }
            for at in 0..order1.len() / C {
                let pixel = pixels.map_or(tile * TILE + at, |list| list[tile * TILE + at]);
                let (x, y) = ((pixel % width) as f64, (pixel / width) as f64);
                let pixel = view.pixel(camera, (x, y), &outline, fine);
                let own = at * C..(at + 1) * C;
                order1[own.clone()].copy_from_slice(&pixel.order1);
                order2[at * S..(at + 1) * S].copy_from_slice(&pixel.source);
                transmittance[own.clone()].copy_from_slice(&pixel.through);
                emitted[own.clone()].copy_from_slice(&pixel.emitted);
                background[own].copy_from_slice(&pixel.background);
            }
        });
    image
}

/// Everything along view rays that does not change from ray to ray.
pub(super) struct View<'a, const C: usize, const S: usize> {
    pub volumes: &'a Volumes<'a>,
    pub field: Field<'a>,
    pub albedo: Option<Field<'a>>,
    phase: &'a Phase,
    pub isotropic: bool,
    pub extinction: [f32; 3],
    pub constant_albedo: [f32; 3],
    pub least_extinction: f32,
    most_extinction: f32,
    pub h: [f64; 3],
    /// Whether rays take even steps, unless they pass a light.
    pub even: bool,
    pub packed: Option<Packed>,
    glow: Option<Glow<'a>>,
    backdrop: Option<Backdrop<'a>>,
}

/// The means over a pixel.
struct Pixel<const C: usize, const S: usize> {
    order1: [f32; C],
    source: [f32; S],
    through: [f32; C],
    emitted: [f32; C],
    background: [f32; C],
}

impl<'a, const C: usize, const S: usize> View<'a, C, S> {
    pub fn new(volumes: &'a Volumes<'a>) -> Self {
        let medium = &volumes.scene.medium;
        let extinction = medium.extinction.rgb.map(|e| e as f32);
        let (constant_albedo, albedo) = match medium.albedo {
            Albedo::Constant(a) => (a.rgb.map(|x| x as f32), None),
            Albedo::PerVoxel(values) => ([1.0; 3], Some(Field::new(values, &medium.volume))),
        };
        let h = medium.volume.spacing();
        let depth = medium.max_sigma_t() * h.into_iter().fold(0.0, f64::max);
        View {
            volumes,
            field: Field::density(&medium.volume).skipping(volumes.occupancy),
            albedo,
            phase: &medium.phase,
            isotropic: medium.phase.is_isotropic(),
            extinction,
            constant_albedo,
            least_extinction: extinction.iter().copied().fold(f32::INFINITY, f32::min),
            most_extinction: extinction.iter().copied().fold(0.0, f32::max),
            h,
            even: suits(depth, medium.volume.linear(), medium.volume.is_constant()),
            packed: None,
            glow: None,
            backdrop: None,
        }
    }

    /// The same view, with what the medium emits and what lies behind it.
    fn whole(self) -> Self {
        let scene = self.volumes.scene;
        View { glow: Glow::new(scene), backdrop: Backdrop::new(scene), ..self }
    }

    /// The mean over the pixel with the upper left corner (x, y).
    #[inline(always)]
    fn pixel(&self, camera: &Camera, (x, y): (f64, f64), outline: &Outline, fine: usize) -> Pixel<C, S> {
        let centre = self.range(camera, x + 0.5, y + 0.5);
        let rays = self.rays(camera, centre.as_ref(), (outline, x, y), fine);
        let n = rays.per_axis;
        let finer = self.backdrop.as_ref().map_or(1, |backdrop| backdrop.samples(camera).div_ceil(n));
        let mut mean =
            Pixel { order1: [0.0; C], source: [0.0; S], through: [0.0; C], emitted: [0.0; C], background: [0.0; C] };
        let stride = stride(n);
        let weights = rays.covered.map(|area| outline.weights((x, y), area, n));
        for at in 0..n * n {
            let (u, v) = point(n, stride, at);
            let weight = weights.as_ref().map_or(1.0 / (n * n) as f32, |weights| weights[at]);
            let mut through = [1.0f32; C];
            if let Some(mut ray) = if n == 1 { centre } else { self.range(camera, x + u, y + v) } {
                ray.least_off /= n as f32;
                let sums = self.ray(&ray);
                through = std::array::from_fn(|c| (-self.extinction[c] * sums.column).exp());
                (0..C).for_each(|c| mean.order1[c] += weight * sums.order1[c]);
                (0..S).for_each(|s| mean.source[s] += weight * sums.source[s]);
                if let Some(glow) = &self.glow {
                    let emitted = glow.along::<C>(ray.p, ray.v, ray.length);
                    (0..C).for_each(|c| mean.emitted[c] += weight * emitted[c]);
                }
            }
            (0..C).for_each(|c| mean.through[c] += weight * through[c]);
            if let Some(backdrop) = &self.backdrop {
                let corner = (x + (at % n) as f64 / n as f64, y + (at / n) as f64 / n as f64);
                let behind = backdrop.mean(camera, corner, 1.0 / n as f64, finer);
                (0..C).for_each(|c| mean.background[c] += weight * through[c] * behind[c]);
            }
        }
        mean
    }

    /// The ray through a point of the image, within the box.
    #[inline(always)]
    fn range(&self, camera: &Camera, x: f64, y: f64) -> Option<Ray> {
        let ViewRay { p, v, direction, start, length } = ViewRay::new(self.volumes.scene, camera, x, y)?;
        let middle = start + 0.5 * f64::from(length);
        Some(Ray { p, v, direction, length, least_off: (0.1 * camera.pixel_width(middle)) as f32 })
    }

    /// Sums along one ray.
    #[inline(always)]
    fn ray(&self, ray: &Ray) -> Sums<C, S> {
        let even = if self.even && !self.passes_light(ray) { self.even(ray) } else { None };
        even.unwrap_or_else(|| self.exact(ray))
    }

    /// Sums along one ray, cell by cell.
    fn exact(&self, ray: &Ray) -> Sums<C, S> {
        let mut sums = Sums { order1: [0.0; C], source: [0.0; S], column: 0.0 };
        let linear = self.field.linear();
        self.field.visit(ray.p, ray.v, ray.length, |cell, t0, t1| {
            if linear {
                let corners = self.field.corners(cell);
                self.cell(&mut sums, ray, (t0, t1), |t| corners.at(local(along(ray.p, ray.v, t), cell)));
            } else {
                let value = self.field.voxel(cell);
                self.cell(&mut sums, ray, (t0, t1), |_| value);
            }
            sums.column * self.least_extinction <= OPAQUE
        });
        sums
    }

    /// Adds what [t0, t1] of a ray, within one cell, sends to the eye.
    #[inline(always)]
    fn cell(&self, sums: &mut Sums<C, S>, ray: &Ray, (t0, t1): (f32, f32), density: impl Fn(f32) -> f32) {
        let (u1, u2) = (GAUSS[1][0].0 as f32, GAUSS[1][1].0 as f32);
        let length = t1 - t0;
        let (s1, s2) = (density(t0 + u1 * length), density(t0 + u2 * length));
        if s1 <= 0.0 && s2 <= 0.0 {
            return;
        }
        let depth = 0.5 * (s1 + s2) * length * self.most_extinction;
        let steps = ((depth / STEP_DEPTH).ceil() as usize).clamp(1, MOST_STEPS);
        let step = length / steps as f32;
        for i in 0..steps {
            if sums.column * self.least_extinction > OPAQUE {
                return;
            }
            let start = t0 + step * i as f32;
            let (s1, s2) = if steps == 1 { (s1, s2) } else { (density(start + u1 * step), density(start + u2 * step)) };
            let profile = Profile { s1, slope: (s2 - s1) / (u2 - u1), step };
            let node = |u: f32, s: f32| {
                let p = along(ray.p, ray.v, start + u * step);
                (p, self.factor(p, s * 0.5 * step, sums.column + profile.column(u)))
            };
            let nodes = [node(u1, s1), node(u2, s2)];
            for light in &self.volumes.lights {
                match close_light(light, self.h, along(ray.p, ray.v, start), ray.direction, step) {
                    Some(foot) => self.close(sums, light, foot, ray, start, &profile),
                    None => self.lit(sums, light, &nodes, ray, start, &profile),
                }
            }
            for (p, factor) in &nodes {
                self.volume_terms(sums, *p, factor);
            }
            sums.column += 0.5 * (s1 + s2) * step;
        }
    }

    /// Adds what the volumes hold at a node.
    #[inline(always)]
    pub fn volume_terms(&self, sums: &mut Sums<C, S>, p: V3, factor: &[f32; C]) {
        if let Some(source) = self.volumes.source0 {
            let j = interpolate::<C>(source, self.field.n(), p);
            for c in 0..C {
                sums.order1[c] += factor[c] * j[c];
            }
        }
        if let Some(source) = self.volumes.source {
            let j = interpolate::<S>(source, self.field.n(), p);
            for s in 0..S {
                sums.source[s] += factor[s / (S / C)] * j[s];
            }
        }
    }

    /// sigma_s * length * transmittance at a node, by channel.
    #[inline(always)]
    fn factor(&self, p: V3, weight: f32, column: f32) -> [f32; C] {
        let albedo = self.albedo.as_ref().map_or(1.0, |field| field.at(p));
        std::array::from_fn(|c| {
            self.extinction[c] * self.constant_albedo[c] * albedo * weight * (-self.extinction[c] * column).exp()
        })
    }

    /// P from the light's direction into that towards the eye, which is against the view ray.
    #[inline(always)]
    pub fn toward_eye(&self, light: &V3, view: &V3) -> f32 {
        if self.isotropic {
            return 0.25 * std::f32::consts::FRAC_1_PI;
        }
        self.phase.pdf(-(light[0] * view[0] + light[1] * view[1] + light[2] * view[2]).clamp(-1.0, 1.0))
    }
}

/// A view ray within the box.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ray {
    pub p: V3,
    pub v: V3,
    pub direction: V3,
    pub length: f32,
    /// Nearest that it is taken to pass a light: a part of its share of the pixel.
    least_off: f32,
}

/// `N` values per voxel, linear between voxel centres.
#[inline(always)]
pub(super) fn interpolate<const N: usize>(values: &[f32], n: [i32; 3], p: V3) -> [f32; N] {
    let (x0, x1, u) = between(p[0], n[0]);
    let (y0, y1, v) = between(p[1], n[1]);
    let (z0, z1, w) = between(p[2], n[2]);
    let (row, slice) = (n[0] as usize, (n[0] * n[1]) as usize);
    let mut sum = [0.0f32; N];
    for (z, wz) in [(z0 * slice, 1.0 - w), (z1 * slice, w)] {
        for (y, wy) in [(y0 * row, 1.0 - v), (y1 * row, v)] {
            for (x, wx) in [(x0, 1.0 - u), (x1, u)] {
                let at = (z + y + x) * N;
                let weight = wz * wy * wx;
                let cell = &values[at..at + N];
                for i in 0..N {
                    sum[i] += weight * cell[i];
                }
            }
        }
    }
    sum
}

/// J of incident order 0 that pencil beams send towards the eye of a camera, `channels` values a voxel; `None` without any.
pub fn beams(scene: &Scene, camera: &Camera, channels: usize) -> Option<Vec<f32>> {
    let volume = &scene.medium.volume;
    let (n, h) = (volume.n(), volume.spacing().map(|c| c as f32));
    let eye = LocalEye::new(scene, camera);
    let mut source: Option<Vec<f32>> = None;
    for light in &scene.lights {
        let Light::Pencil { position, direction, power } = light else { continue };
        let source = source.get_or_insert_with(|| vec![0.0; volume.voxels() * channels]);
        let along = direction.map(|c| c as f32);
        over_beam(scene, *position, *direction, |cell, path, _| {
            let toward = eye.from(cell.map(|c| c as f32 + 0.5), h);
            let p = f64::from(scene.medium.phase.pdf(cosine(toward, along))) / volume.voxel_volume();
            for c in 0..channels {
                let at = (cell[2] * n[1] + cell[1]) * n[0] + cell[0];
                source[at * channels + c] += (power.rgb[c] * path[c] * p) as f32;
            }
        });
    }
    source
}
