//! The gather on the GPU: [`cpu::gather`](crate::backend::cpu::gather) cell by cell.
//!
//! How many rays a pixel takes is found on the CPU, in double precision. Pixels with equally many make batches; a batch's rays
//! are walked by dispatches of bounded work, from one of which to the next their sums lie in a buffer. Four values of the
//! source volume are gathered at a time.

use super::device::Gpu;
use super::kernel::{Binding, Kernel};
use super::lights::Lights;
use super::scene::{GpuScene, Texture};
use crate::backend::cpu::gather::{self as cpu, Image, Volumes, rays_per_axis};
use crate::backend::cpu::light::Illumination;
use crate::error::{Error, Result};
use crate::scene::camera::Eye;
use crate::scene::{Camera, Light, Scene};
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use std::sync::Arc;

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
struct Job {
    rays: u32,
    samples: u32,
    steps: u32,
    begin: u32,
    lights: u32,
    pixels: u32,
    spare: [u32; 2],
    channels: [u32; 4],
}

/// `Sums` of `shaders/gather_ray.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Sums {
    cell: [i32; 3],
    t: f32,
    next: [f32; 3],
    column: f32,
    order1: [f32; 3],
    part: u32,
    source: [f32; 4],
    light: u32,
    over: u32,
    spare: [u32; 2],
}

/// `Pixel` of `shaders/gather_mean.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Pixel {
    order1: [f32; 3],
    spare: f32,
    transmittance: [f32; 3],
    spare_too: f32,
    source: [f32; 4],
}

/// Rays of a batch: on a GPU, and on a processor that plays one.
const RAYS: [usize; 2] = [1 << 18, 1 << 14];
/// Cells that the rays of a dispatch and their light rays cross.
const CELLS: [usize; 2] = [1 << 25, 1 << 22];
/// Loop iterations that an invocation may make at most.
const ITERATIONS: usize = 60_000;
/// Iterations of a step without long light rays: those next to a point light are eight, and short.
const SHORT: usize = 512;
/// Values of the source volume that are gathered at a time.
const GROUP: usize = 4;

/// The layers of all pixels, or of the given ones ([`cpu::image`]); a stop is an error.
pub fn image(
    gpu: &Gpu,
    volumes: &Volumes,
    camera: &Camera,
    pixels: Option<&[usize]>,
    stride: usize,
    whole: bool,
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
    let batches = batches(&fine, RAYS[usize::from(gpu.software)]);
    let groups = if volumes.source.is_some() { stride.div_ceil(GROUP) } else { 1 };
    for group in 0..groups {
        let own = group * GROUP..stride.min((group + 1) * GROUP);
        let lit = if group == 0 { volumes.lights.as_slice() } else { &[] };
        let pass = Pass::new(gpu, &scene, volumes, camera, lit, (group, stride), &batches)?;
        for batch in &batches {
            let means = pass.batch(gpu, batch, pixels, stop)?;
            for (&slot, mean) in batch.slots.iter().zip(means) {
                image.order2[slot * stride + own.start..slot * stride + own.end]
                    .copy_from_slice(&mean.source[..own.len()]);
                if group == 0 {
                    let values = slot * channels..(slot + 1) * channels;
                    image.order1[values.clone()].copy_from_slice(&mean.order1[..channels]);
                    image.transmittance[values].copy_from_slice(&mean.transmittance[..channels]);
                }
            }
        }
    }
    if whole {
        behind(volumes, camera, pixels, &mut image, stop);
    }
    if stop() { Err(Error::Interrupted) } else { Ok(image) }
}

/// Adds what the medium emits and what lies behind it.
fn behind(
    volumes: &Volumes,
    camera: &Camera,
    pixels: Option<&[usize]>,
    image: &mut Image,
    stop: &(impl Fn() -> bool + Sync),
) {
    let scene = volumes.scene;
    let mapped = scene.lights.iter().any(|light| matches!(light, Light::Environment { map: Some(_), .. }));
    if mapped || scene.medium.emission.is_some() {
        let only = Volumes {
            scene,
            occupancy: volumes.occupancy,
            lights: Vec::new(),
            source: None,
            source0: None,
            channels: volumes.channels,
        };
        let found = cpu::image(&only, camera, pixels, volumes.channels, true, stop);
        (image.emitted, image.background) = (found.emitted, found.background);
        return;
    }
    let mut sky = [0.0f32; 3];
    for light in &scene.lights {
        if let Light::Environment { radiance, map: None } = light {
            (0..3).for_each(|c| sky[c] += radiance.rgb[c] as f32);
        }
    }
    for (at, (behind, through)) in image.background.iter_mut().zip(&image.transmittance).enumerate() {
        *behind = through * sky[at % volumes.channels];
    }
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
    let mut list = Vec::new();
    for samples in 1..=u8::MAX {
        let slots: Vec<usize> = (0..fine.len()).filter(|&at| fine[at] == samples).collect();
        let samples = usize::from(samples);
        let most = (most / (samples * samples)).max(1);
        list.extend(slots.chunks(most).map(|slots| Batch { samples, slots: slots.to_vec() }));
    }
    list
}

/// What gathers order 1 and four values of the source volume, or such values only.
struct Pass<'a> {
    scene: &'a GpuScene,
    lights: Lights,
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
        volumes: &Volumes,
        camera: &Camera,
        lit: &[Illumination],
        (group, stride): (usize, usize),
        batches: &[Batch],
    ) -> Result<Self> {
        let volume = &volumes.scene.medium.volume;
        let n = volume.n();
        let lights = Lights::new(gpu, lit.iter().map(|light| (light, 1.0)))?;
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
        files.push(match volumes.source0.filter(|_| group == 0) {
            Some(source0) => {
                textures.push(("source0", layers(gpu, source0, n, volumes.channels, 0)?));
                "source0_voxels"
            }
            None => "source0_none",
        });
        let offset = if volume.linear() { 0.5 } else { 0.0 };
        let walk = gpu.kernel(scene.source(&files).with("OFFSET", offset))?;
        let mean = gpu.kernel(scene.source(&["gather_mean", "gather_ray"]))?;
        let most_rays = batches.iter().map(|b| b.slots.len() * b.samples * b.samples).max().unwrap_or(0) as u64;
        let most_pixels = batches.iter().map(|b| b.slots.len()).max().unwrap_or(0) as u64;
        let k = (stride / volumes.channels).max(1);
        let channel = |at: usize| (((group * GROUP + at) / k).min(volumes.channels - 1)) as u32;
        // A light without a grid, or with one that did not fit.
        let grids = lit.iter().filter_map(Illumination::grid).map(<[f32]>::len).sum::<usize>() as u64 * 4;
        let rays = lit.iter().any(|light| light.nodes().is_none()) || grids > gpu.binding();
        Ok(Pass {
            scene,
            lights,
            walk,
            mean,
            textures,
            buffers: vec![
                ("sums", gpu.empty(most_rays * size_of::<Sums>() as u64)?),
                ("view", gpu.uniform(&View::new(volumes.scene, camera))?),
            ],
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
        stop: &(impl Fn() -> bool + Sync),
    ) -> Result<Vec<Pixel>> {
        let numbers: Vec<u32> = batch.slots.iter().map(|&at| pixels.map_or(at, |list| list[at]) as u32).collect();
        gpu.write(&self.pixels, 0, &numbers);
        let mut bindings = self.scene.bindings();
        bindings.extend(self.lights.bindings());
        bindings.extend(self.textures.iter().map(|(name, texture)| (*name, Binding::Texture(&texture.view))));
        bindings.extend(self.buffers.iter().map(|(name, buffer)| (*name, Binding::Buffer(buffer))));
        bindings.extend(
            [("job", &self.job), ("busy", &self.busy), ("pixels", &self.pixels), ("means", &self.means)]
                .map(|(name, buffer)| (name, Binding::Buffer(buffer))),
        );
        let rays = numbers.len() * batch.samples * batch.samples;
        // Two nodes of a step, and a few lookups in their place where the light grid is read.
        let cost = (2 * self.light_ray).max(4);
        let by_work = CELLS[usize::from(gpu.software)] / (rays * cost);
        let steps = by_work.min(ITERATIONS / (2 * self.light_ray + SHORT)).max(1);
        let mut job = Job {
            rays: rays as u32,
            samples: batch.samples as u32,
            steps: steps as u32,
            begin: 1,
            lights: self.lights.count,
            pixels: numbers.len() as u32,
            channels: self.channels,
            ..Job::default()
        };
        loop {
            if stop() {
                return Err(Error::Interrupted);
            }
            gpu.write(&self.job, 0, &[job]);
            gpu.write(&self.busy, 0, &[0u32]);
            gpu.run(&self.walk, &bindings, rays as u64)?;
            if gpu.read::<u32>(&self.busy, 1)? == [0] {
                break;
            }
            job.begin = 0;
        }
        gpu.run(&self.mean, &bindings, numbers.len() as u64)?;
        gpu.read(&self.means, numbers.len())
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
    use crate::backend::cpu::gather::by_cells;
    use crate::physics::Phase;
    use crate::plan::Column;
    use crate::scene::{Albedo, Camera, Light, Medium, Spectrum, Volume};

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
            ("rgb, per voxel", Case { extinction: rgb, stride: 3, per_voxel: true, linear: false, ..one.clone() }),
            ("lights", Case { lights: vec![parallel(), point([1.8, -0.7, 1.6]), parallel(), sky], ..one.clone() }),
            ("no light", Case { lights: Vec::new(), ..one.clone() }),
            ("light inside", Case { lights: vec![inside.clone()], ..one.clone() }),
            (
                "light inside, rays",
                Case { lights: vec![inside, parallel()], column: Column::Rays, phase: hg, ..one.clone() },
            ),
            ("orthographic", Case { camera: wide, ..one.clone() }),
            ("from within", Case { camera: perspective([0.3, 0.4, 0.6], 100.0), ..one.clone() }),
            ("from far away", Case { camera: perspective(far, 6e-5), ..one.clone() }),
            ("pixels", Case { pixels: Some(vec![250, 7, 130, 131, 479]), ..one }),
        ]
    }

    #[test]
    fn the_image_is_that_of_the_cpu_cell_by_cell() {
        let mut failed = Vec::new();
        for (name, case) in cases() {
            let worst = case.with(|volumes| {
                let expected = by_cells(volumes, &case.camera, case.pixels.as_deref());
                assert!(expected.order2.iter().any(|&x| x > 0.0), "{name}");
                differences(&case.on_gpu(volumes), &expected)
            });
            println!("{name}: {worst:?}");
            if worst.iter().any(|&d| d > 1e-4) {
                failed.push(name);
            }
        }
        assert!(failed.is_empty(), "{failed:?}");
    }
}
