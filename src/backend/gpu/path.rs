//! Path tracing on the GPU: the view rays of a pass in jobs, whose slots take ray after ray, each with all of its paths.

use super::device::Gpu;
use super::gather::View;
use super::kernel::{Binding, Kernel};
use super::lights::Lights;
use super::map::Maps;
use super::scene::GpuScene;
use crate::backend::cpu::flights::{Course, Scored};
use crate::backend::cpu::path::connect::Connections;
use crate::backend::cpu::path::walk::PATH;
use crate::backend::cpu::path::{Passes, Rays, Sums};
use crate::error::Result;
use crate::physics::rng::split;
use bytemuck::{Pod, Zeroable};
use std::ops::Range;
use std::sync::Arc;

/// `Job` of `shaders/paths.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
struct Job {
    resolution: [u32; 2],
    first: [u32; 2],
    columns: u32,
    count: u32,
    number: [u32; 2],
    pixel: u32,
    rays: u32,
    slots: u32,
    steps: u32,
    background: [f32; 3],
    images: u32,
}

/// `Image` of `shaders/paths.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
struct Image {
    pixel: [i32; 2],
    place: [f32; 2],
}

/// Bytes of `Path` of `shaders/paths.wgsl`, with three channels.
const STATE: u64 = 288;
/// View rays of a job at most.
const RAYS: usize = 1 << 19;
/// View rays under way at once, and steps of each in a dispatch: on a GPU, and on a processor that plays one.
const SLOTS: [u32; 2] = [1 << 16, 1 << 12];
const STEPS: u32 = 64;
/// Iterations of all loops of an invocation that no driver cuts short.
const ITERATIONS: u64 = 60_000;
/// Dispatches between two looks at how many slots are over.
const UNSEEN: u32 = 1;

/// What traces paths on a GPU.
pub struct Paths<'a> {
    gpu: &'a Gpu,
    rays: &'a Rays<'a>,
    scene: GpuScene,
    lights: Lights,
    maps: Maps,
    majorants: wgpu::Buffer,
    images: wgpu::Buffer,
    view: wgpu::Buffer,
    job: wgpu::Buffer,
    state: wgpu::Buffer,
    counters: wgpu::Buffer,
    seen: wgpu::Buffer,
    kernel: Arc<Kernel>,
    /// What all jobs have in common.
    common: Job,
}

impl<'a> Paths<'a> {
    /// For a plan.
    pub fn new(gpu: &'a Gpu, rays: &'a Rays<'a>, connections: &Connections) -> Result<Self> {
        let Rays { plan, paths, window, images } = rays;
        let course = Course::new(plan, Scored::Nowhere, PATH);
        let mut scene = GpuScene::new(gpu, plan.scene, plan.channels)?;
        scene.update(gpu, |constants| {
            constants.seed = split(plan.settings.seed);
            constants.last = plan.orders;
            constants.free_path = course.free_path();
            if let Some((block, n, _)) = course.majorants() {
                (constants.block, constants.cells) = (block as i32, n);
            }
        });
        let far = connections.far.iter().map(|light| (&light.view, light.check));
        let lights = Lights::new(gpu, far.chain(connections.near.iter().map(|view| (view, 1.0))))?;
        let mut files = vec!["path", "paths", "primary", "camera", "connect", "light", "flights", "path_flights"];
        files.push(if course.certain { "accept_all" } else { "accept_some" });
        files.push(if course.majorants().is_some() { "flights_cells" } else { "flights_one" });
        files.push(if plan.scene.medium.phase.is_isotropic() { "turn_isotropic" } else { "turn_phase" });
        let volume = &plan.scene.medium.volume;
        files.push(match (volume.is_constant(), volume.linear()) {
            (true, _) => "reach_constant",
            (_, false) => "reach_nearest",
            (_, true) => "reach_linear",
        });
        files.push(if connections.near.is_empty() { "near_none" } else { "near_lights" });
        let maps = Maps::new(gpu, connections.maps.iter().copied())?;
        files.extend(if connections.maps.is_empty() { &["maps_none"][..] } else { &["maps_some", "map"] });
        let source = scene
            .source(&files)
            .with("PURPOSE", PATH)
            .with("STARTS", paths.starts as u32)
            .with("WALKED", u8::from(paths.walked))
            .with("FAR_LIGHTS", connections.far.len() as u32)
            .with("NEAR_LIGHTS", connections.near.len() as u32)
            .with("MAPS", connections.maps.len() as u32)
            .with("SEES_OUT", u8::from(connections.has_background()))
            .with("EVENTS", if course.certain { 1 } else { 8 });
        let kernel = gpu.kernel(source)?;
        let seen_at: Vec<Image> = images.iter().map(image).chain([Image::default()]).collect();
        let slots = SLOTS[usize::from(gpu.software)];
        let common = Job {
            resolution: plan.scene.camera.resolution.map(|m| m as u32),
            first: [window[0].0 as u32, window[1].0 as u32],
            columns: (window[0].1 - window[0].0) as u32,
            slots,
            steps: STEPS,
            background: connections.background,
            images: images.len() as u32,
            ..Job::default()
        };
        let majorants = course.majorants().map_or(&[][..], |(_, _, values)| values);
        Ok(Paths {
            gpu,
            rays,
            majorants: gpu.buffer(majorants)?,
            images: gpu.buffer(&seen_at)?,
            view: gpu.uniform(&View::new(plan.scene, &plan.scene.camera))?,
            job: gpu.uniform(&common)?,
            state: gpu.empty(STATE * u64::from(slots))?,
            counters: gpu.empty(8)?,
            seen: gpu.empty(8 * (RAYS * plan.channels) as u64)?,
            scene,
            lights,
            maps,
            kernel,
            common,
        })
    }

    /// The view rays of a job, 2 values of each channel for each; gives the number of real collisions. `None` if it was
    /// halted.
    fn job(&self, job: &Job, halted: &dyn Fn() -> bool) -> Result<Option<(Vec<f32>, u64)>> {
        let mut bindings = self.scene.bindings();
        bindings.extend(self.lights.bindings());
        bindings.extend(self.maps.bindings());
        for (name, buffer) in [
            ("majorants", &self.majorants),
            ("images", &self.images),
            ("view", &self.view),
            ("job", &self.job),
            ("paths", &self.state),
            ("counters", &self.counters),
            ("seen", &self.seen),
        ] {
            bindings.push((name, Binding::Buffer(buffer)));
        }
        self.gpu.write(&self.job, 0, &[*job]);
        self.gpu.clear(&self.state);
        let mut collisions = 0;
        loop {
            self.gpu.clear(&self.counters);
            for _ in 0..UNSEEN {
                self.gpu.run(&self.kernel, &bindings, u64::from(job.slots))?;
            }
            if halted() {
                return Ok(None);
            }
            let counters = self.gpu.read::<u32>(&self.counters, 2)?;
            collisions += u64::from(counters[1]);
            if counters[0] == 0 {
                break;
            }
        }
        let values = 2 * self.rays.plan.channels * job.rays as usize;
        Ok(Some((self.gpu.read(&self.seen, values)?, collisions)))
    }
}

impl<const C: usize> Passes<C> for Paths<'_> {
    fn take(&self, numbers: Range<u64>, sums: &mut [Sums<C>], halted: &(dyn Fn() -> bool + Sync)) -> Result<u64> {
        let [width, height] = self.rays.plan.scene.camera.resolution;
        let count = (numbers.end - numbers.start) as usize;
        let [columns, rows] = self.rays.window;
        let (wide, high) = (columns.1.saturating_sub(columns.0), rows.1.saturating_sub(rows.0));
        let mut collisions = 0;
        for first in (0..wide * high).step_by(RAYS / count) {
            let pixels = (RAYS / count).min(wide * high - first);
            let job = Job {
                count: count as u32,
                number: split(numbers.start.wrapping_mul((width * height) as u64)),
                pixel: first as u32,
                rays: (pixels * count) as u32,
                slots: self.common.slots.min((pixels * count) as u32),
                ..self.common
            };
            let Some((seen, met)) = self.job(&job, &halted)? else { return Ok(collisions) };
            collisions += met;
            let pixel = |at: usize| (rows.0 + (first + at) / wide) * width + columns.0 + (first + at) % wide;
            for (at, rays) in seen.chunks_exact(2 * C * count).enumerate() {
                let sum = &mut sums[pixel(at)];
                for ray in rays.chunks_exact(2 * C) {
                    sum.add(std::array::from_fn(|c| f64::from(ray[c])), std::array::from_fn(|c| f64::from(ray[C + c])));
                }
            }
        }
        Ok(collisions)
    }
}

/// Where a near light is seen.
fn image(place: &[f64; 2]) -> Image {
    // Those far off the image are near no pixel.
    let place = place.map(|c| c.clamp(-1e6, 1e6));
    Image { pixel: place.map(|c| c.floor() as i32), place: place.map(|c| (c - c.floor()) as f32) }
}
