//! The gather on the GPU: [`cpu::gather`](crate::backend::cpu::gather) cell by cell.
//!
//! How many rays a pixel takes is found on the CPU, in double precision. Pixels with equally many make batches; a
//! batch's rays are walked by dispatches of bounded work, from one of which to the next their sums lie in a buffer.
//! Four values of the source volume are gathered at a time.

use super::camera::View;
use super::device::Gpu;
use super::glow::Glow;
use super::kernel::{Binding, Kernel};
use super::lights::Lights;
use super::map::Maps;
use super::pace::{self, ITERATIONS};
use super::scene::{GpuScene, Texture};
use crate::backend::cpu::gather::{Backdrop, Image, Outline, Rays, Volumes, rays, stride};
use crate::backend::cpu::light::Illumination;
use crate::error::{Error, Result};
use crate::scene::Camera;
use crate::scene::field::BLOCK;
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

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
    pub stride: u32,
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
    pub at: u32,
    pub width: u32,
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
    let outline = Outline::new(volumes.scene, camera);
    let rays = rays(volumes, camera, &outline, pixels);
    let count = rays.len();
    let mut image = Image {
        order1: vec![0.0; count * channels],
        order2: vec![0.0; count * stride],
        transmittance: vec![1.0; count * channels],
        emitted: vec![0.0; count * channels],
        background: vec![0.0; count * channels],
    };
    let scene = GpuScene::kept(gpu, volumes.scene, channels)?;
    let batches = batches(&rays, cut.rays);
    let groups = if volumes.source.is_some() { stride.div_ceil(GROUP) } else { 1 };
    for group in 0..groups {
        let own = group * GROUP..stride.min((group + 1) * GROUP);
        let pass = Pass::new(gpu, &scene, volumes, (camera, &outline), (group, stride, whole), &batches)?;
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
    /// The part of each pixel that the medium covers, where its outline runs through it.
    covered: Vec<Option<f64>>,
}

/// Batches of no more than `most` rays from those of each pixel.
fn batches(rays: &[Rays], most: usize) -> Vec<Batch> {
    let mut equal: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (at, rays) in rays.iter().enumerate() {
        equal.entry(rays.per_axis).or_default().push(at);
    }
    let cut = |(samples, slots): (usize, Vec<usize>)| {
        let most = (most / (samples * samples)).max(1);
        let covered = |slots: &[usize]| slots.iter().map(|&at| rays[at].covered).collect();
        let batch = |slots: &[usize]| Batch { samples, slots: slots.to_vec(), covered: covered(slots) };
        slots.chunks(most).map(batch).collect::<Vec<_>>()
    };
    equal.into_iter().flat_map(cut).collect()
}

/// What gathers order 1 and four values of the source volume, or such values only.
struct Pass<'a> {
    scene: &'a GpuScene,
    backdrop: Option<Backdrop<'a>>,
    camera: &'a Camera,
    outline: &'a Outline,
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
    weights: wgpu::Buffer,
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
        (camera, outline): (&'a Camera, &'a Outline),
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
        let mut files = vec![
            "gather",
            "gather_ray",
            "gather_close",
            "gather_lit",
            "camera",
            View::file(camera),
            "interpolate",
            "light",
        ];
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
                let kernel = gpu.kernel(scene.source(&[&files[..], &glow.files()].concat()))?;
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
        let mean = gpu.kernel(scene.source(&mean))?;
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
            outline,
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
            weights: gpu.empty(most_rays * 4)?,
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
        let (n, width) = (batch.samples, self.camera.resolution[0]);
        let mut weights = vec![1.0 / (n * n) as f32; numbers.len() * n * n];
        for ((own, &pixel), covered) in weights.chunks_mut(n * n).zip(&numbers).zip(&batch.covered) {
            if let Some(area) = *covered {
                let place = ((pixel as usize % width) as f64, (pixel as usize / width) as f64);
                own.copy_from_slice(&self.outline.weights(place, area, n));
            }
        }
        gpu.write(&self.weights, 0, &weights);
        let mut bindings = self.scene.bindings();
        bindings.extend(self.lights.bindings());
        bindings.extend(self.maps.bindings());
        bindings.extend(self.glow.iter().flat_map(|(glow, _)| glow.bindings()));
        bindings.extend(self.textures.iter().map(|(name, texture)| (*name, Binding::Texture(&texture.view))));
        bindings.extend(self.buffers.iter().map(|(name, buffer)| (*name, Binding::Buffer(buffer))));
        bindings.extend(
            [
                ("job", &self.job),
                ("busy", &self.busy),
                ("pixels", &self.pixels),
                ("weights", &self.weights),
                ("means", &self.means),
            ]
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
            stride: stride(batch.samples) as u32,
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
mod tests;
