//! The gather on the GPU: [`cpu::gather`](crate::backend::cpu::gather) cell by cell.
//!
//! How many rays a pixel takes is found on the CPU, in double precision. Pixels with equally many make batches; a
//! batch's rays are walked by dispatches of bounded work, from one of which to the next their sums lie in a buffer.
//! Four values of the source volume are gathered at a time.

use super::device::Gpu;
use super::glow::Glow;
use super::kernel::{Binding, Kernel};
use super::lights::Lights;
use super::map::Maps;
use super::pace::{self, ITERATIONS};
use super::scene::{GpuScene, Texture};
use crate::backend::cpu::gather::{Backdrop, Image, Volumes, rays_per_axis};
use crate::backend::cpu::light::Illumination;
use crate::error::{Error, Result};
use crate::scene::camera::Eye;
use crate::scene::field::BLOCK;
use crate::scene::{Camera, Scene};
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

/// `View` of `shaders/camera.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[expect(missing_docs, reason = "the shader names and describes them")]
pub struct View {
    pub passing: [f32; 3],
    pub depth: f32,
    pub passing_x: [f32; 3],
    pub pixel: f32,
    pub passing_y: [f32; 3],
    pub width: u32,
    pub ahead: [f32; 3],
    pub column: i32,
    pub ahead_x: [f32; 3],
    pub row: i32,
    pub ahead_y: [f32; 3],
    pub spare: u32,
}

impl View {
    /// What a camera sees of a scene.
    pub fn new(scene: &Scene, camera: &Camera) -> Self {
        let volume = &scene.medium.volume;
        let (h, size) = (volume.spacing(), volume.size());
        let eye = volume.local(camera.origin);
        let [forward, x, y] = camera.axes();
        let to: [f64; 3] = std::array::from_fn(|a| 0.5 * size[a] - eye[a]);
        let [radius, distance] = [size.map(|s| 0.5 * s), to].map(|r| r.iter().map(|c| c * c).sum::<f64>().sqrt());
        let depth = (0..3).map(|a| to[a] * forward[a]).sum::<f64>();
        let centre = volume.world(size.map(|s| 0.5 * s));
        let middle = camera.resolution.map(|m| 0.5 * m as f64);
        let seen = camera.project(centre).unwrap_or(middle);
        let [column, row]: [f64; 2] = std::array::from_fn(|a| seen[a].floor().clamp(0.0, camera.resolution[a] as f64));
        // What that pixel's ray adds to the direction ahead, or to its start.
        let aside: [f64; 3] = std::array::from_fn(|a| (column - middle[0]) * x[a] + (row - middle[1]) * y[a]);
        let ahead: [f64; 3] = std::array::from_fn(|a| forward[a] + aside[a]);
        let voxels = |v: [f64; 3]| -> [f32; 3] { std::array::from_fn(|a| (v[a] / h[a]) as f32) };
        let single = |v: [f64; 3]| v.map(|c| c as f32);
        let common = View {
            pixel: camera.pixel_width(1.0) as f32,
            width: camera.resolution[0] as u32,
            column: column as i32,
            row: row as i32,
            ..View::default()
        };
        match camera.eye() {
            Eye::Point(_) => {
                // From the box's neighbourhood the eye itself is near enough.
                let depth = if depth <= 0.0 || distance < 4.0 * radius { 0.0 } else { depth };
                View {
                    passing: voxels(std::array::from_fn(|a| eye[a] + depth * ahead[a])),
                    depth: depth as f32,
                    passing_x: voxels(x.map(|c| depth * c)),
                    passing_y: voxels(y.map(|c| depth * c)),
                    ahead: single(ahead),
                    ahead_x: single(x),
                    ahead_y: single(y),
                    ..common
                }
            }
            Eye::Direction(_) => View {
                passing: voxels(std::array::from_fn(|a| eye[a] + aside[a] + depth * forward[a])),
                depth: depth as f32,
                passing_x: voxels(x),
                passing_y: voxels(y),
                ahead: single(forward),
                ..common
            },
        }
    }

    /// The shader file of a camera's kind.
    pub fn file(camera: &Camera) -> &'static str {
        match camera.eye() {
            Eye::Point(_) => "camera_perspective",
            Eye::Direction(_) => "camera_orthographic",
        }
    }
}

/// `Job` of `shaders/gather_ray.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[expect(missing_docs, reason = "the shader names and describes them")]
pub struct Job {
    pub rays: u32,
    pub samples: u32,
    pub steps: u32,
    pub begin: u32,
    pub lights: u32,
    pub pixels: u32,
    pub maps: u32,
    pub finer: u32,
    pub channels: [u32; 4],
    pub sky: [f32; 3],
    pub spare: u32,
}

/// `Sums` of `shaders/gather_ray.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[expect(missing_docs, reason = "the shader names and describes them")]
pub struct Sums {
    pub cell: [i32; 3],
    pub t: f32,
    pub next: [f32; 3],
    pub column: f32,
    pub order1: [f32; 3],
    pub part: u32,
    pub source: [f32; 4],
    pub light: u32,
    pub over: u32,
    pub spare: [u32; 2],
}

/// `Pixel` of `shaders/gather_mean.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[expect(missing_docs, reason = "the shader names and describes them")]
pub struct Pixel {
    pub order1: [f32; 3],
    pub spare: f32,
    pub transmittance: [f32; 3],
    pub spare_too: f32,
    pub background: [f32; 3],
    pub spare_again: f32,
    pub emitted: [f32; 3],
    pub spare_at_last: f32,
    pub source: [f32; 4],
}

/// How work is cut into dispatches; results do not depend on it.
#[derive(Debug, Clone, Copy)]
struct Cut {
    /// Rays of a batch.
    rays: usize,
    /// Cells that the rays of a dispatch and their light rays cross.
    cells: usize,
}

impl Cut {
    /// For an adapter.
    fn new(gpu: &Gpu) -> Self {
        if gpu.software { Cut { rays: 1 << 14, cells: 1 << 22 } } else { Cut { rays: 1 << 18, cells: 1 << 25 } }
    }
}

/// Iterations of a step without long light rays: those next to a point light are eight, and short.
const SHORT: usize = 512;
/// Iterations in a cell that emits, and what one costs in cells.
const GLOW_ITERATIONS: usize = 500;
const GLOW_COST: usize = 8;
/// Bytes of `Glow` of `shaders/glow.wgsl`.
const GLOW: u64 = 48;
/// Values of the source volume that are gathered at a time.
const GROUP: usize = 4;

/// The layers of all pixels, or of the given ones ([`crate::backend::cpu::gather::image`]); a stop is an error.
pub fn image(
    gpu: &Gpu,
    volumes: &Volumes,
    camera: &Camera,
    pixels: Option<&[usize]>,
    stride: usize,
    whole: bool,
    stop: &(impl Fn() -> bool + Sync),
) -> Result<Image> {
    gather(gpu, volumes, camera, pixels, (stride, whole), Cut::new(gpu), stop)
}

/// The same, with work cut as asked.
fn gather(
    gpu: &Gpu,
    volumes: &Volumes,
    camera: &Camera,
    pixels: Option<&[usize]>,
    (stride, whole): (usize, bool),
    cut: Cut,
    stop: &(impl Fn() -> bool + Sync),
) -> Result<Image> {
    let channels = volumes.channels;
    let fine = rays_per_axis(volumes, camera, pixels);
    let count = fine.len();
    let mut image = Image {
        order1: vec![0.0; count * channels],
        order2: vec![0.0; count * stride],
        transmittance: vec![1.0; count * channels],
        emitted: vec![0.0; count * channels],
        background: vec![0.0; count * channels],
    };
    let scene = GpuScene::new(gpu, volumes.scene, channels)?;
    let batches = batches(&fine, cut.rays);
    let groups = if volumes.source.is_some() { stride.div_ceil(GROUP) } else { 1 };
    for group in 0..groups {
        let own = group * GROUP..stride.min((group + 1) * GROUP);
        let pass = Pass::new(gpu, &scene, volumes, camera, (group, stride, whole), &batches)?;
        for batch in &batches {
            let means = pass.batch(gpu, batch, pixels, cut, stop)?;
            for (&slot, mean) in batch.slots.iter().zip(means) {
                image.order2[slot * stride + own.start..slot * stride + own.end]
                    .copy_from_slice(&mean.source[..own.len()]);
                if group == 0 {
                    let values = slot * channels..(slot + 1) * channels;
                    image.order1[values.clone()].copy_from_slice(&mean.order1[..channels]);
                    image.transmittance[values.clone()].copy_from_slice(&mean.transmittance[..channels]);
                    image.emitted[values.clone()].copy_from_slice(&mean.emitted[..channels]);
                    image.background[values].copy_from_slice(&mean.background[..channels]);
                }
            }
        }
    }
    Ok(image)
}

/// Pixels with equally many rays.
struct Batch {
    /// Rays per axis.
    samples: usize,
    /// Places in the image.
    slots: Vec<usize>,
}

/// Batches of no more than `most` rays from the pixels' rays per axis.
fn batches(fine: &[u8], most: usize) -> Vec<Batch> {
    let mut equal: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (at, &samples) in fine.iter().enumerate() {
        equal.entry(usize::from(samples)).or_default().push(at);
    }
    let cut = |(samples, slots): (usize, Vec<usize>)| {
        let most = (most / (samples * samples)).max(1);
        slots.chunks(most).map(|slots| Batch { samples, slots: slots.to_vec() }).collect::<Vec<_>>()
    };
    equal.into_iter().flat_map(cut).collect()
}

/// What gathers order 1 and four values of the source volume, or such values only.
struct Pass<'a> {
    scene: &'a GpuScene,
    backdrop: Option<Backdrop<'a>>,
    camera: &'a Camera,
    lights: Lights,
    maps: Maps,
    glow: Option<(Glow, Arc<Kernel>)>,
    walk: Arc<Kernel>,
    mean: Arc<Kernel>,
    textures: Vec<(&'static str, Texture)>,
    buffers: Vec<(&'static str, wgpu::Buffer)>,
    job: wgpu::Buffer,
    busy: wgpu::Buffer,
    pixels: wgpu::Buffer,
    means: wgpu::Buffer,
    channels: [u32; 4],
    /// Cells that a light ray of each step may cross.
    light_ray: usize,
}

impl<'a> Pass<'a> {
    fn new(
        gpu: &Gpu,
        scene: &'a GpuScene,
        volumes: &Volumes<'a>,
        camera: &'a Camera,
        (group, stride, whole): (usize, usize, bool),
        batches: &[Batch],
    ) -> Result<Self> {
        let first = group == 0;
        let volume = &volumes.scene.medium.volume;
        let n = volume.n();
        let lit = if first { volumes.lights.as_slice() } else { &[] };
        let lights = Lights::new(gpu, lit.iter().map(|light| (light, 1.0)))?;
        let backdrop = if first && whole { Backdrop::new(volumes.scene) } else { None };
        let maps = Maps::new(gpu, backdrop.iter().flat_map(|backdrop| backdrop.maps.iter().copied()))?;
        let mut textures = Vec::new();
        let mut files =
            vec!["gather", "gather_ray", "gather_close", "camera", View::file(camera), "interpolate", "light"];
        files.push(match (volume.is_constant(), volume.linear()) {
            (true, _) => "cells_constant",
            (false, true) => "cells_linear",
            (false, false) => "cells_nearest",
        });
        files.push(match volumes.source {
            Some(source) => {
                textures.push(("source", layers(gpu, source, n, stride, group * GROUP)?));
                "source_voxels"
            }
            None => "source_none",
        });
        files.push(match volumes.source0.filter(|_| first) {
            Some(source0) => {
                textures.push(("source0", layers(gpu, source0, n, volumes.channels, 0)?));
                "source0_voxels"
            }
            None => "source0_none",
        });
        let mut buffers = Vec::new();
        files.push(match volumes.occupancy {
            Some(occupancy) => {
                let word = |bits: &[bool]| bits.iter().enumerate().fold(0u32, |w, (i, &bit)| w | u32::from(bit) << i);
                let words: Vec<u32> = occupancy.blocks().chunks(32).map(word).collect();
                buffers.push(("occupied", gpu.buffer(&words)?));
                "skip_blocks"
            }
            None => "skip_none",
        });
        let offset = if volume.linear() { 0.5 } else { 0.0 };
        let walk = gpu.kernel(scene.source(&files).with("OFFSET", offset).with("BLOCK", BLOCK as f64))?;
        let glow = if first && whole { Glow::new(gpu, &volumes.scene.medium)? } else { None };
        let mut mean = vec!["gather_mean", "gather_ray", "camera"];
        let glow = match glow {
            Some(glow) => {
                let files = ["gather_glow", "gather_ray", "camera", "emitted_rays"];
                let kernel = gpu.kernel(glow.set(scene.source(&[&files[..], &glow.files()].concat())))?;
                mean.push("emitted_rays");
                mean.extend(glow.files());
                Some((glow, kernel))
            }
            None => {
                mean.push("emitted_none");
                None
            }
        };
        mean.extend(if maps.count > 0 { ["backdrop_maps", "map"].as_slice() } else { &["backdrop_constant"] });
        let mean = scene.source(&mean);
        let mean = gpu.kernel(glow.iter().fold(mean, |mean, (glow, _)| glow.set(mean)))?;
        let most_rays = batches.iter().map(|b| b.slots.len() * b.samples * b.samples).max().unwrap_or(0) as u64;
        let most_pixels = batches.iter().map(|b| b.slots.len()).max().unwrap_or(0) as u64;
        buffers.push(("sums", gpu.empty(most_rays * size_of::<Sums>() as u64)?));
        buffers.push(("view", gpu.uniform(&View::new(volumes.scene, camera))?));
        if glow.is_some() {
            buffers.push(("glows", gpu.empty(most_rays * GLOW)?));
        }
        let k = (stride / volumes.channels).max(1);
        let channel = |at: usize| (((group * GROUP + at) / k).min(volumes.channels - 1)) as u32;
        // A light without a grid, or with one that did not fit.
        let grids = lit.iter().filter_map(Illumination::grid).map(<[f32]>::len).sum::<usize>() as u64 * 4;
        let rays = lit.iter().any(|light| light.nodes().is_none()) || grids > gpu.binding();
        Ok(Pass {
            scene,
            backdrop,
            camera,
            lights,
            maps,
            glow,
            walk,
            mean,
            textures,
            buffers,
            job: gpu.uniform(&Job::default())?,
            busy: gpu.empty(4)?,
            pixels: gpu.empty(most_pixels * 4)?,
            means: gpu.empty(most_pixels * size_of::<Pixel>() as u64)?,
            channels: std::array::from_fn(channel),
            light_ray: if rays && !volume.is_constant() { n.iter().sum::<usize>() + 16 } else { 0 },
        })
    }

    /// The means over a batch's pixels.
    fn batch(
        &self,
        gpu: &Gpu,
        batch: &Batch,
        pixels: Option<&[usize]>,
        cut: Cut,
        stop: &(impl Fn() -> bool + Sync),
    ) -> Result<Vec<Pixel>> {
        let numbers: Vec<u32> = batch.slots.iter().map(|&at| pixels.map_or(at, |list| list[at]) as u32).collect();
        gpu.write(&self.pixels, 0, &numbers);
        let mut bindings = self.scene.bindings();
        bindings.extend(self.lights.bindings());
        bindings.extend(self.maps.bindings());
        bindings.extend(self.glow.iter().flat_map(|(glow, _)| glow.bindings()));
        bindings.extend(self.textures.iter().map(|(name, texture)| (*name, Binding::Texture(&texture.view))));
        bindings.extend(self.buffers.iter().map(|(name, buffer)| (*name, Binding::Buffer(buffer))));
        bindings.extend(
            [("job", &self.job), ("busy", &self.busy), ("pixels", &self.pixels), ("means", &self.means)]
                .map(|(name, buffer)| (name, Binding::Buffer(buffer))),
        );
        let rays = numbers.len() * batch.samples * batch.samples;
        // Two nodes of a step, and a few lookups in their place where the light grid is read.
        let cost = (2 * self.light_ray).max(4);
        let most = (ITERATIONS as usize / (2 * self.light_ray + SHORT)).max(1);
        let steps = (cut.cells / (rays * cost)).clamp(1, most);
        let finer = self.backdrop.as_ref().map_or(1, |backdrop| backdrop.samples(self.camera).div_ceil(batch.samples));
        let mut job = Job {
            rays: rays as u32,
            samples: batch.samples as u32,
            steps: steps as u32,
            begin: 1,
            lights: self.lights.count,
            pixels: numbers.len() as u32,
            maps: self.maps.count,
            finer: finer as u32,
            channels: self.channels,
            sky: self.backdrop.as_ref().map_or([0.0; 3], |backdrop| backdrop.constant),
            spare: 0,
        };
        self.finish(gpu, &self.walk, &bindings, (job, most as u32), stop)?;
        if let Some((_, kernel)) = &self.glow {
            let most = ITERATIONS as usize / GLOW_ITERATIONS;
            job.steps = (cut.cells / (rays * GLOW_COST)).clamp(1, most) as u32;
            self.finish(gpu, kernel, &bindings, (job, most as u32), stop)?;
        }
        gpu.run(&self.mean, &bindings, numbers.len() as u64)?;
        gpu.read(&self.means, numbers.len())
    }

    /// Runs a kernel, at most so many steps at once, until all of its rays have ended.
    fn finish(
        &self,
        gpu: &Gpu,
        kernel: &Kernel,
        bindings: &[(&str, Binding)],
        (mut job, most): (Job, u32),
        stop: &(impl Fn() -> bool + Sync),
    ) -> Result<()> {
        loop {
            if stop() {
                return Err(Error::Interrupted);
            }
            gpu.write(&self.job, 0, &[job]);
            gpu.write(&self.busy, 0, &[0u32]);
            let began = Instant::now();
            gpu.run(kernel, bindings, u64::from(job.rays))?;
            if gpu.read::<u32>(&self.busy, 1)? == [0] {
                return Ok(());
            }
            job.begin = 0;
            job.steps = pace::next(job.steps, began, most);
        }
    }
}

/// Up to four values of each voxel, from the one at `first` on of `stride`.
fn layers(gpu: &Gpu, values: &[f32], n: [usize; 3], stride: usize, first: usize) -> Result<Texture> {
    let count = GROUP.min(stride - first);
    let (format, width) = match count {
        1 => (wgpu::TextureFormat::R32Float, 1),
        2 => (wgpu::TextureFormat::Rg32Float, 2),
        _ => (wgpu::TextureFormat::Rgba32Float, 4),
    };
    if count == stride && width == stride {
        return Ok(Texture { view: gpu.texture(n, format, bytemuck::cast_slice(values))?, unit: 1.0 });
    }
    let mut texels = vec![0.0f32; values.len() / stride * width];
    texels
        .par_chunks_mut(width)
        .zip(values.par_chunks(stride))
        .with_min_len(1 << 12)
        .for_each(|(texel, values)| texel[..count].copy_from_slice(&values[first..first + count]));
    Ok(Texture { view: gpu.texture(n, format, bytemuck::cast_slice(&texels))?, unit: 1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::Control;
    use crate::backend::cpu::gather::{self as cpu, by_cells};
    use crate::backend::gpu::device::for_tests;
    use crate::physics::Phase;
    use crate::plan::Column;
    use crate::scene::environment::Map;
    use crate::scene::field::Occupancy;
    use crate::scene::{Albedo, Camera, Emission, Light, Medium, Spectrum, Volume};

    const N: [usize; 3] = [14, 11, 9];
    const H: [f64; 3] = [1.0, 1.2, 0.8];
    const ORIGIN: [f64; 3] = [3.0, -2.0, 100.0];
    const UP: [f64; 3] = [0.0, 0.0, 1.0];

    /// What a scene is made of, and how it is seen.
    #[derive(Clone)]
    struct Case {
        linear: bool,
        constant: bool,
        extinction: Vec<f64>,
        per_voxel: bool,
        phase: Phase,
        lights: Vec<Light>,
        column: Column,
        source0: bool,
        emission: usize,
        stride: usize,
        camera: Camera,
        pixels: Option<Vec<usize>>,
    }

    /// A point in the world from one in parts of the box.
    fn place(part: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| ORIGIN[a] + part[a] * N[a] as f64 * H[a])
    }

    fn perspective(eye: [f64; 3], fov: f64) -> Camera {
        Camera::perspective(place(eye), place([0.5; 3]), UP, fov, [24, 20]).expect("valid")
    }

    fn point(part: [f64; 3]) -> Light {
        Light::point(place(part), &[100.0]).expect("valid")
    }

    fn parallel() -> Light {
        Light::directional([-1.0, 0.3, -0.6], &[2.0]).expect("valid")
    }

    impl Default for Case {
        fn default() -> Self {
            Case {
                linear: true,
                constant: false,
                extinction: vec![0.5],
                per_voxel: false,
                phase: Phase::Isotropic,
                lights: vec![point([1.8, -0.7, 1.6])],
                column: Column::Grid,
                source0: false,
                emission: 0,
                stride: 1,
                camera: perspective([2.5, -1.5, 1.4], 30.0),
                pixels: None,
            }
        }
    }

    fn spectrum(values: &[f64]) -> Spectrum {
        Spectrum::new(values, "value").expect("valid")
    }

    /// A value for each voxel.
    fn field(value: impl Fn([f32; 3]) -> f32) -> Vec<f32> {
        (0..N[0] * N[1] * N[2])
            .map(|at| value([at % N[0], at / N[0] % N[1], at / (N[0] * N[1])].map(|c| c as f32)))
            .collect()
    }

    impl Case {
        /// What `look` gives for the case's volumes.
        fn with<T>(&self, look: impl FnOnce(&Volumes) -> T) -> T {
            let channels = self.extinction.len();
            let bumps = |p: [f32; 3]| (1.0 + (0.9 * p[0]).sin() * (0.7 * p[1] + 1.0).cos() * (0.8 * p[2]).sin()) * 0.7;
            let density =
                if self.constant { vec![0.6; N[0] * N[1] * N[2]] } else { field(|p| (bumps(p) - 0.4).max(0.0)) };
            let albedo = field(|p| 0.5 + 0.4 * (0.3 * p[0] + 0.2 * p[1]).sin());
            let j = field(|p| 2.0 + (0.9 * p[0] + 0.7 * p[2] - 0.4 * p[1]).cos());
            let times = |count: usize| -> Vec<f32> {
                j.iter()
                    .enumerate()
                    .flat_map(|(at, j)| (0..count).map(move |s| j * (1.0 + s as f32) + ((at + s) % 5) as f32))
                    .collect()
            };
            let (source, source0) = (times(self.stride), times(channels));
            let volume = Volume::new(&density, N, H, ORIGIN, self.linear).expect("valid");
            let constant = Albedo::Constant(spectrum(&[0.9, 0.8, 0.7][..channels]));
            let albedo = if self.per_voxel { Albedo::PerVoxel(&albedo) } else { constant };
            let medium = Medium::new(volume, spectrum(&self.extinction), albedo, self.phase.clone()).expect("valid");
            let glow: Vec<f32> = [0.3, 0.2, 0.4][..self.emission]
                .iter()
                .flat_map(|scale| {
                    field(|p| (scale * (1.0 + (0.7 * p[0] - scale * p[1] + 0.5 * p[2]).sin()) - 0.2).max(0.0))
                })
                .collect();
            let emission = (self.emission > 0).then(|| Emission::new(&glow, self.emission, &volume).expect("valid"));
            let medium = medium.emitting(emission);
            let scene = Scene::new(medium, self.lights.clone(), self.camera);
            let view = |light, nodes| Illumination::new(&scene, None, light, self.column, nodes);
            let grids: Vec<Option<Vec<f32>>> = self
                .lights
                .iter()
                .map(|light| view(light, None).map(|view| view.columns(&Control::new(None))))
                .collect();
            let lights = self.lights.iter().zip(&grids);
            let lights = lights.filter_map(|(light, grid)| view(light, grid.as_deref())).collect();
            let source0 = self.source0.then_some(source0.as_slice());
            look(&Volumes { scene: &scene, occupancy: None, lights, source: Some(&source), source0, channels })
        }

        fn on_gpu(&self, volumes: &Volumes) -> Image {
            let gpu = Gpu::open("").expect("an adapter");
            image(&gpu, volumes, &self.camera, self.pixels.as_deref(), self.stride, true, &|| false).expect("it runs")
        }
    }

    /// The largest difference of two layers over the largest value of the second.
    fn difference(found: &[f32], expected: &[f32]) -> f32 {
        assert_eq!(found.len(), expected.len());
        let top = expected.iter().fold(0.0f32, |m, x| m.max(x.abs()));
        let worst = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0f32, f32::max);
        assert!(found.iter().all(|x| x.is_finite()));
        if top > 0.0 { worst / top } else { worst }
    }

    /// The differences of all layers.
    fn differences(found: &Image, expected: &Image) -> [f32; 5] {
        [
            difference(&found.order1, &expected.order1),
            difference(&found.order2, &expected.order2),
            difference(&found.transmittance, &expected.transmittance),
            difference(&found.emitted, &expected.emitted),
            difference(&found.background, &expected.background),
        ]
    }

    fn cases() -> Vec<(&'static str, Case)> {
        let one = Case::default();
        let hg = Phase::henyey_greenstein(0.8).expect("valid");
        let table = Phase::tabulated(&[-1.0, -0.2, 0.5, 1.0], &[0.3, 0.1, 0.4, 3.0]).expect("valid");
        let inside = point([0.52, 0.47, 0.55]);
        let far = [0.5 + 1e6, 0.5 - 1e6, 0.5 + 5e5];
        let sky = Light::environment(&[0.7]).expect("valid");
        let rgb = vec![0.5, 0.3, 0.8];
        let on_ray = |camera: &Camera| {
            let (start, d) = camera.ray(12.0 + 9.5 / 16.0, 11.0 + 3.5 / 16.0);
            let way = (0..3).map(|a| (place([0.5; 3])[a] - start[a]) * d[a]).sum::<f64>();
            vec![Light::point(std::array::from_fn(|a| start[a] + way * d[a]), &[100.0]).expect("valid")]
        };
        let wide = Camera::orthographic(place([2.0, -1.0, 1.5]), place([0.5; 3]), UP, 25.0, [24, 20]).expect("valid");
        vec![
            ("linear", one.clone()),
            ("nearest", Case { linear: false, ..one.clone() }),
            ("constant, linear", Case { constant: true, ..one.clone() }),
            ("constant, nearest", Case { constant: true, linear: false, ..one.clone() }),
            ("light rays", Case { column: Column::Rays, ..one.clone() }),
            ("light rays, nearest", Case { column: Column::Rays, linear: false, ..one.clone() }),
            ("deep", Case { extinction: vec![40.0], ..one.clone() }),
            ("hg", Case { phase: hg.clone(), ..one.clone() }),
            ("rayleigh", Case { phase: Phase::Rayleigh, ..one.clone() }),
            ("tabulated", Case { phase: table, ..one.clone() }),
            ("albedo per voxel", Case { per_voxel: true, ..one.clone() }),
            ("albedo per voxel, nearest", Case { per_voxel: true, linear: false, ..one.clone() }),
            ("source0", Case { source0: true, ..one.clone() }),
            ("rgb", Case { extinction: rgb.clone(), stride: 3, source0: true, phase: hg.clone(), ..one.clone() }),
            (
                "rgb, per voxel",
                Case { extinction: rgb.clone(), stride: 3, per_voxel: true, linear: false, ..one.clone() },
            ),
            ("lights", Case { lights: vec![parallel(), point([1.8, -0.7, 1.6]), parallel(), sky], ..one.clone() }),
            ("emission", Case { emission: 1, extinction: vec![3.0], ..one.clone() }),
            ("emission, nearest", Case { emission: 1, linear: false, ..one.clone() }),
            ("emission, rgb", Case { emission: 3, extinction: rgb.clone(), stride: 3, ..one.clone() }),
            ("no light", Case { lights: Vec::new(), ..one.clone() }),
            ("light inside", Case { lights: vec![inside.clone()], ..one.clone() }),
            (
                "light inside, rays",
                Case { lights: vec![inside, parallel()], column: Column::Rays, phase: hg, ..one.clone() },
            ),
            ("light on a ray", Case { lights: on_ray(&one.camera), ..one.clone() }),
            ("light on a ray, orthographic", Case { lights: on_ray(&wide), camera: wide, ..one.clone() }),
            ("orthographic", Case { camera: wide, ..one.clone() }),
            ("from within", Case { camera: perspective([0.3, 0.4, 0.6], 100.0), ..one.clone() }),
            ("from within, wide", Case { camera: perspective([0.3, 0.4, 0.6], 179.95), ..one.clone() }),
            ("from far away", Case { camera: perspective(far, 6e-5), ..one.clone() }),
            ("pixels", Case { pixels: Some(vec![250, 7, 130, 131, 479]), ..one }),
        ]
    }

    #[test]
    fn the_image_is_that_of_the_cpu_cell_by_cell() {
        if for_tests().is_none() {
            return;
        }
        let mut failed = Vec::new();
        for (name, case) in cases() {
            let worst = case.with(|volumes| {
                let expected = by_cells(volumes, &case.camera, case.pixels.as_deref());
                assert!(expected.order2.iter().any(|&x| x > 0.0), "{name}");
                differences(&case.on_gpu(volumes), &expected)
            });
            // What is deep is seen through many exponentials.
            if worst.iter().any(|&d| d > 2e-5) {
                failed.push((name, worst));
            }
        }
        assert!(failed.is_empty(), "{failed:?}");
    }

    #[test]
    fn the_image_does_not_depend_on_the_cut() {
        let Some(gpu) = for_tests() else { return };
        let inside = point([0.52, 0.47, 0.55]);
        let lights = vec![inside, parallel()];
        let case =
            Case { extinction: vec![5.0], lights, column: Column::Rays, stride: 8, emission: 1, ..Case::default() };
        case.with(|volumes| {
            let with = |rays, cells| {
                gather(&gpu, volumes, &case.camera, None, (8, true), Cut { rays, cells }, &|| false).expect("it runs")
            };
            let (one, other) = (with(1 << 14, 1 << 28), with(3000, 1 << 18));
            let layers =
                |image: &Image| [&image.order1, &image.order2, &image.transmittance, &image.emitted].map(Vec::clone);
            assert!(layers(&one) == layers(&other));
            assert!(layers(&one).iter().all(|layer| layer.iter().any(|&x| x > 0.0)));
        });
    }

    #[test]
    fn replicates_are_those_of_the_cpu_one_by_one() {
        if for_tests().is_none() {
            return;
        }
        for (extinction, k) in [(vec![0.5], 8), (vec![0.5], 5), (vec![0.5, 0.3, 0.8], 8), (vec![0.5, 0.3, 0.8], 2)] {
            let channels = extinction.len();
            let case = Case { extinction, stride: channels * k, ..Case::default() };
            case.with(|volumes| {
                let found = case.on_gpu(volumes);
                for replicate in 0..k {
                    let own =
                        |values: &[f32]| -> Vec<f32> { values.iter().skip(replicate).step_by(k).copied().collect() };
                    let slice = volumes.source.map(own);
                    let one = Volumes { source: slice.as_deref(), lights: volumes.lights.clone(), ..*volumes };
                    let expected = by_cells(&one, &case.camera, None);
                    assert!(difference(&own(&found.order2), &expected.order2) < 2e-6, "{replicate} of {k}");
                    assert!(difference(&found.order1, &expected.order1) < 2e-6);
                }
            });
        }
    }

    #[test]
    fn even_steps_of_the_cpu_differ_by_their_quadrature_only() {
        if for_tests().is_none() {
            return;
        }
        let case = Case { extinction: vec![0.1], ..Case::default() };
        case.with(|volumes| {
            let expected = cpu::image(volumes, &case.camera, None, 1, true, &|| false);
            let worst = differences(&case.on_gpu(volumes), &expected);
            assert!(worst[0] > 1e-5, "these are no even steps");
            assert!(worst.iter().all(|&d| d < 5e-3), "{worst:?}");
        });
    }

    #[test]
    fn a_stop_is_an_error() {
        let Some(gpu) = for_tests() else { return };
        let case = Case::default();
        case.with(|volumes| {
            let stopped = image(&gpu, volumes, &case.camera, None, 1, true, &|| true);
            assert_eq!(stopped.err(), Some(Error::Interrupted));
        });
    }

    #[test]
    fn long_light_rays_from_every_step_end() {
        let Some(gpu) = for_tests() else { return };
        let n = [700usize, 3, 2];
        let density: Vec<f32> = (0..4200).map(|i| 0.5 + ((i * 7919) % 101) as f32 / 100.0).collect();
        let volume = Volume::new(&density, n, [1.0; 3], [0.0; 3], true).expect("valid");
        let medium = Medium::new(volume, spectrum(&[0.004]), Albedo::Constant(spectrum(&[0.9])), Phase::Isotropic);
        let camera = Camera::perspective([-9.0, 1.4, 1.1], [700.0, 1.5, 1.0], UP, 9.0, [3, 3]).expect("valid");
        let light = Light::directional([-1.0, 0.0005, 0.0004], &[2.0]).expect("valid");
        let scene = Scene::new(medium.expect("valid"), vec![light], camera);
        let lights = Illumination::new(&scene, None, &scene.lights[0], Column::Rays, None).into_iter().collect();
        let volumes = Volumes { scene: &scene, occupancy: None, lights, source: None, source0: None, channels: 1 };
        let found = image(&gpu, &volumes, &camera, None, 1, true, &|| false).expect("it runs");
        let expected = by_cells(&volumes, &camera, None);
        assert!(expected.order1[4] > 0.0 && expected.transmittance[4] < 0.9);
        let worst = differences(&found, &expected);
        assert!(worst.iter().all(|&d| d < 2e-5), "{worst:?}");
    }

    #[test]
    fn empty_blocks_are_passed_and_nothing_else() {
        let Some(gpu) = for_tests() else { return };
        let n = [40usize, 25, 33];
        let value = |at: usize| {
            let (i, j, k) = (at % n[0], at / n[0] % n[1], at / (n[0] * n[1]));
            if (i / 5 + j / 7 + k / 9) % 5 == 0 { ((at * 7919) % 101) as f32 / 100.0 } else { 0.0 }
        };
        let density: Vec<f32> = (0..n.iter().product()).map(value).collect();
        for linear in [false, true] {
            let volume = Volume::new(&density, n, [1.0; 3], [0.0; 3], linear).expect("valid");
            let medium = Medium::new(volume, spectrum(&[0.5]), Albedo::Constant(spectrum(&[0.9])), Phase::Isotropic);
            let camera =
                Camera::perspective([90.0, -60.0, 50.0], [20.0, 12.0, 16.0], UP, 35.0, [24, 20]).expect("valid");
            let scene = Scene::new(medium.expect("valid"), vec![parallel()], camera);
            let occupancy = Occupancy::new(&scene.medium.volume).expect("much is empty");
            let lights: Vec<_> =
                Illumination::new(&scene, None, &scene.lights[0], Column::Rays, None).into_iter().collect();
            let with = |occupancy| {
                let volumes = Volumes {
                    scene: &scene,
                    occupancy,
                    lights: lights.clone(),
                    source: Some(&density),
                    source0: None,
                    channels: 1,
                };
                let found = image(&gpu, &volumes, &camera, None, 1, true, &|| false).expect("it runs");
                let cut = Cut { rays: 300, cells: 1 << 13 };
                let again = gather(&gpu, &volumes, &camera, None, (1, true), cut, &|| false).expect("it runs");
                assert!(found.order1 == again.order1 && found.order2 == again.order2);
                (found, by_cells(&volumes, &camera, None))
            };
            for occupancy in [None, Some(&occupancy)] {
                let (found, expected) = with(occupancy);
                let worst = differences(&found, &expected);
                assert!(worst.iter().all(|&d| d < 5e-6), "{linear} {}: {worst:?}", occupancy.is_some());
            }
        }
    }

    #[test]
    fn balls_and_flat_volumes_are_seen_as_on_the_cpu() {
        let Some(gpu) = for_tests() else { return };
        for (n, ball) in [([1usize, 1, 1], true), ([1, 1, 1], false), ([5, 1, 3], false)] {
            let density: Vec<f32> = (0..n.iter().product()).map(|i| 0.5 + i as f32).collect();
            let volume = Volume::new(&density, n, [2.0; 3], ORIGIN, false).expect("valid");
            let volume = if ball { volume.ball().expect("valid") } else { volume };
            let eye = [ORIGIN[0] + 9.0, ORIGIN[1] - 14.0, ORIGIN[2] + 6.0];
            let target = [ORIGIN[0] + n[0] as f64, ORIGIN[1] + 1.0, ORIGIN[2] + n[2] as f64];
            let camera = Camera::perspective(eye, target, UP, 30.0, [24, 20]).expect("valid");
            let sky = Map::new((0..128).map(|i| ((i * 7) % 11) as f32).collect(), 16, 8, 1).expect("valid");
            let lights = vec![
                parallel(),
                Light::environment_map(sky).expect("valid"),
                Light::environment(&[0.5]).expect("valid"),
            ];
            let medium = Medium::new(volume, spectrum(&[0.4]), Albedo::Constant(spectrum(&[0.9])), Phase::Rayleigh);
            let scene = Scene::new(medium.expect("valid"), lights, camera);
            let lights = Illumination::new(&scene, None, &scene.lights[0], Column::Rays, None).into_iter().collect();
            let source: Vec<f32> = density.iter().map(|d| 1.0 + 0.3 * d).collect();
            let volumes =
                Volumes { scene: &scene, occupancy: None, lights, source: Some(&source), source0: None, channels: 1 };
            let found = image(&gpu, &volumes, &camera, None, 1, true, &|| false).expect("it runs");
            let worst = differences(&found, &by_cells(&volumes, &camera, None));
            assert!(worst.iter().all(|&d| d < 2e-5), "{n:?} {ball}: {worst:?}");
        }
    }
}
