//! Path tracing on the GPU: the view rays of a pass in jobs, whose slots take ray after ray, each with all of its paths.

use super::device::Gpu;
use super::gather::View;
use super::kernel::{Binding, Kernel};
use super::lights::Lights;
use super::map::Maps;
use super::scene::{GpuScene, Texture};
use super::tracker::Track;
use crate::backend::cpu::flights::{Course, Scored};
use crate::backend::cpu::path::connect::Connections;
use crate::backend::cpu::path::walk::PATH;
use crate::backend::cpu::path::{Passes, Rays, Sums};
use crate::error::{Error, Result};
use crate::physics::rng::split;
use crate::plan::Plan;
use crate::scene::Volume;
use crate::scene::environment::Map;
use crate::scene::medium::Emission;
use bytemuck::{Pod, Zeroable};
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

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
    glow: [f32; 3],
    spare: u32,
}

/// `Image` of `shaders/paths.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
struct Image {
    pixel: [i32; 2],
    place: [f32; 2],
}

/// Bytes of `Path` of `shaders/paths.wgsl`, with three channels.
const STATE: u64 = 304;
/// View rays of a job at most.
const RAYS: usize = 1 << 19;
/// View rays under way at once: on a GPU, and on a processor that plays one.
const SLOTS: [u32; 2] = [1 << 16, 1 << 12];
/// Seconds of a dispatch, about: no desktop freezes, and Ctrl-C is heard.
const DISPATCH: f64 = 0.05;
/// Loop iterations of an invocation in one dispatch: a software adapter silently ends all loops after 65,535 of them.
const ITERATIONS: u32 = 60_000;
/// Cells of majorants that a flight crosses without a pause.
const CELLS: u32 = 32;
/// Tentative collisions between two looks at what paths need else.
const EVENTS: u32 = 8;

/// What traces paths on a GPU.
pub struct Paths<'a> {
    gpu: &'a Gpu,
    rays: &'a Rays<'a>,
    scene: GpuScene,
    lights: Lights,
    maps: Maps,
    glow: Vec<Texture>,
    buffers: Vec<(&'static str, wgpu::Buffer)>,
    job: wgpu::Buffer,
    state: wgpu::Buffer,
    counters: wgpu::Buffer,
    seen: wgpu::Buffer,
    kernel: Arc<Kernel>,
    /// What all jobs have in common.
    common: Job,
    /// Steps of a dispatch at most.
    most: u32,
}

impl<'a> Paths<'a> {
    /// For a plan.
    pub fn new(gpu: &'a Gpu, rays: &'a Rays<'a>, connections: &Connections) -> Result<Self> {
        let Rays { plan, paths, window, images } = rays;
        let medium = &plan.scene.medium;
        let mut scene = GpuScene::new(gpu, plan.scene, plan.channels)?;
        let track = if plan.lanes { by_events(plan, &mut scene, gpu) } else { Track::new(plan) };
        scene.update(gpu, |constants| {
            constants.seed = split(plan.settings.seed);
            constants.last = plan.orders;
            (constants.block, constants.cells) = (track.block, track.cells);
        });
        let far = connections.far.iter().map(|light| (&light.view, light.check));
        let lights = Lights::new(gpu, far.chain(connections.near.iter().map(|view| (view, 1.0))))?;
        let maps = Maps::new(gpu, connections.maps.iter().copied())?;
        let planes = |glow: &Emission<'a>| -> Result<Vec<Texture>> {
            let plane = |c| Texture::new(gpu, glow.field(c, &medium.volume).values(), medium.volume.n());
            (0..glow.channels()).map(plane).collect()
        };
        let glow = medium.emission.as_ref().map_or(Ok(Vec::new()), planes)?;
        let files = [files(plan, connections, glow.len()), track.files].concat();
        let source = scene
            .source(&files)
            .with("PURPOSE", PATH)
            .with("STARTS", paths.starts as u32)
            .with("WALKED", u8::from(paths.walked))
            .with("FAR_LIGHTS", connections.far.len() as u32)
            .with("NEAR_LIGHTS", connections.near.len() as u32)
            .with("MAPS", maps.count)
            .with("SEES_OUT", u8::from(connections.has_background()))
            .with("FLIES_OUT", u8::from(connections.has_background() || !glow.is_empty()));
        let kernel = gpu.kernel(track.constants.iter().fold(source, |source, (name, value)| source.with(name, *value)))?;
        let step = step_iterations(&medium.volume, connections, glow.len()) + track.iterations;
        if step > ITERATIONS && gpu.software {
            return Err(Error::VolumeTooLarge(format!(
                "light rays through this volume take {step} steps, and the GPU {} ends after {ITERATIONS}; use \
                 backend=\"cpu\"",
                gpu.description.name
            )));
        }
        let seen_at: Vec<Image> = images.iter().map(image).chain([Image::default()]).collect();
        let slots = SLOTS[usize::from(gpu.software)];
        let unit = |c: usize| glow.get(c % glow.len().max(1)).map_or(0.0, |texture| texture.unit);
        let common = Job {
            resolution: plan.scene.camera.resolution.map(|m| m as u32),
            first: [window[0].0 as u32, window[1].0 as u32],
            columns: (window[0].1 - window[0].0) as u32,
            slots,
            background: connections.background,
            images: images.len() as u32,
            glow: [unit(0), unit(1), unit(2)],
            ..Job::default()
        };
        Ok(Paths {
            gpu,
            rays,
            buffers: vec![
                ("majorants", gpu.buffer(&track.majorants)?),
                ("cell_scores", gpu.buffer(&vec![0u32; track.majorants.len()])?),
                ("images", gpu.buffer(&seen_at)?),
                ("view", gpu.uniform(&View::new(plan.scene, &plan.scene.camera))?),
            ],
            job: gpu.uniform(&common)?,
            state: gpu.empty(STATE * u64::from(slots))?,
            counters: gpu.empty(8)?,
            seen: gpu.empty(8 * (RAYS * plan.channels) as u64)?,
            scene,
            lights,
            maps,
            glow,
            kernel,
            common,
            most: (ITERATIONS / step).max(1),
        })
    }

    /// What the view rays of a job see, 2 values of each channel for each, and the number of real collisions; `None` if it
    /// was halted.
    fn take(&self, job: &Job, halted: &dyn Fn() -> bool) -> Result<Option<(Vec<f32>, u64)>> {
        let mut bindings = self.scene.bindings();
        bindings.extend(self.lights.bindings());
        bindings.extend(self.maps.bindings());
        let glow = ["glow_0", "glow_1", "glow_2"];
        bindings.extend(glow.into_iter().zip(&self.glow).map(|(name, t)| (name, Binding::Texture(&t.view))));
        bindings.extend(self.buffers.iter().map(|(name, buffer)| (*name, Binding::Buffer(buffer))));
        bindings.extend([
            ("job", Binding::Buffer(&self.job)),
            ("paths", Binding::Buffer(&self.state)),
            ("counters", Binding::Buffer(&self.counters)),
            ("seen", Binding::Buffer(&self.seen)),
        ]);
        self.gpu.clear(&self.state);
        let (mut collisions, mut steps) = (0, 8.min(self.most));
        loop {
            if halted() {
                return Ok(None);
            }
            self.gpu.write(&self.job, 0, &[Job { steps, ..*job }]);
            self.gpu.clear(&self.counters);
            let began = Instant::now();
            self.gpu.run(&self.kernel, &bindings, u64::from(job.slots))?;
            let counters = self.gpu.read::<u32>(&self.counters, 2)?;
            collisions += u64::from(counters[1]);
            if counters[0] == 0 {
                break;
            }
            let factor = (DISPATCH / began.elapsed().as_secs_f64()).clamp(0.5, 2.0);
            steps = ((f64::from(steps) * factor) as u32).clamp(1, self.most);
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
            let Some((seen, met)) = self.take(&job, &halted)? else { return Ok(collisions) };
            collisions += met;
            let pixel = |at: usize| (rows.0 + (first + at) / wide) * width + columns.0 + (first + at) % wide;
            for (at, rays) in seen.chunks_exact(2 * C * count).enumerate() {
                let sum = &mut sums[pixel(at)];
                for ray in rays.chunks_exact(2 * C) {
                    let light = |from: usize| std::array::from_fn(|c| f64::from(ray[from + c]));
                    sum.add(light(0), light(C));
                }
            }
        }
        Ok(collisions)
    }
}

/// Null-collision flights, event by event.
fn by_events(plan: &Plan, scene: &mut GpuScene, gpu: &Gpu) -> Track {
    let course = Course::new(plan, Scored::Nowhere, PATH);
    let isotropic = plan.scene.medium.phase.is_isotropic();
    scene.update(gpu, |constants| constants.free_path = course.free_path());
    let (block, cells, majorants) = course.majorants().unwrap_or((1.0, [1; 3], &[]));
    let events = if course.certain { 1 } else { EVENTS };
    Track {
        files: vec![
            "flights",
            "weights_grey",
            if majorants.is_empty() { "flights_one" } else { "flights_cells" },
            if isotropic { "turn_isotropic" } else { "turn_phase" },
            if course.certain { "accept_all" } else { "accept_some" },
        ],
        constants: vec![("EVENTS", f64::from(events)), ("CELLS", f64::from(CELLS))],
        block: block as i32,
        cells,
        iterations: events * (1 + if majorants.is_empty() { 0 } else { CELLS }),
        majorants: majorants.to_vec(),
    }
}

/// The shader files of a plan, apart from those of its flights.
fn files(plan: &Plan, connections: &Connections, glow: usize) -> Vec<&'static str> {
    let volume = &plan.scene.medium.volume;
    let mut files = vec!["path", "paths", "primary", "camera", "connect", "light", "flight_state", "roulette"];
    files.push(if plan.lanes { "path_flights" } else { "path_tracker" });
    files.push(if plan.chromatic { "first_chromatic" } else { "first_grey" });
    files.push(match (volume.is_constant(), volume.linear()) {
        (true, _) => "reach_constant",
        (_, false) => "reach_nearest",
        (_, true) => "reach_linear",
    });
    files.push(if connections.near.is_empty() { "near_none" } else { "near_lights" });
    files.extend(if connections.maps.is_empty() { &["maps_none"][..] } else { &["maps_some", "map"] });
    files.extend(match glow {
        0 => &["glow_none"][..],
        1 => &["glow_some", "glow_1"],
        _ => &["glow_some", "glow_3"],
    });
    if glow > 0 {
        files.push(if plan.chromatic { "emitted_chromatic" } else { "emitted_grey" });
    }
    files
}

/// Loop iterations that a step takes at most, apart from those of its flights.
fn step_iterations(volume: &Volume, connections: &Connections, glow: usize) -> u32 {
    // A line crosses one layer of cells more along each axis with interpolation.
    let across = volume.n().iter().sum::<usize>() as u32 + 16;
    let line = if volume.is_constant() { 16 } else { across };
    let (far, near, maps) = (connections.far.len(), connections.near.len(), connections.maps.len());
    let map = |map: &&Map| map.size().iter().map(|m| 2 * m.ilog2()).sum::<u32>();
    let drawn: u32 = connections.maps.iter().map(map).sum();
    // The view ray and its inversion, and for each near light two points on it.
    let primary = 2 * line + 24 + 16 + near as u32 * (3 * line + 1);
    let vertex = far as u32 * (2 * line + 1) + near as u32 * (2 * line + 1) + maps as u32 * (line + 2) + drawn;
    primary + vertex + glow as u32 * across + line
}

/// Where a near light is seen.
fn image(place: &[f64; 2]) -> Image {
    // Those far off the image are near no pixel.
    let place = place.map(|c| c.clamp(-1e6, 1e6));
    Image { pixel: place.map(|c| c.floor() as i32), place: place.map(|c| (c - c.floor()) as f32) }
}
