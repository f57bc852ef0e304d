//! Path tracing on the GPU: the view rays of a pass in jobs, whose slots take ray after ray, each with all of its paths.

use super::camera::View;
use super::device::{GROUP, Gpu};
use super::glow::Glow;
use super::kernel::{Binding, Kernel};
use super::lights::Lights;
use super::map::Maps;
use super::pace::{self, ITERATIONS};
use super::scene::GpuScene;
use super::tracker::Track;
use crate::backend::cpu::course::{Course, Scored};
use crate::backend::cpu::path::connect::Connections;
use crate::backend::cpu::path::walk::PATH;
use crate::backend::cpu::path::{Passes, Rays, Sums};
use crate::error::{Error, Result};
use crate::physics::Phase;
use crate::physics::rng::split;
use crate::plan::Plan;
use crate::scene::environment::Map;
use crate::scene::medium::Emission;
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use std::cell::Cell;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

/// `Job` of `shaders/paths.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[expect(missing_docs, reason = "the shader names and describes them")]
pub struct Job {
    pub resolution: [u32; 2],
    pub first: [u32; 2],
    pub columns: u32,
    pub count: u32,
    pub number: [u32; 2],
    pub pixel: u32,
    pub rays: u32,
    pub slots: u32,
    pub steps: u32,
    pub background: [f32; 3],
    pub images: u32,
    pub slot: u32,
    pub end: u32,
    pub spare: [u32; 2],
}

/// `Image` of `shaders/paths.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[expect(missing_docs, reason = "the shader names and describes them")]
pub struct Image {
    pub pixel: [i32; 2],
    pub place: [f32; 2],
}

/// Bytes of `Path` of `shaders/paths.wgsl`, with three channels.
const STATE: u64 = 288;
/// View rays of a job at most.
const RAYS: usize = 1 << 19;
/// View rays under way at once: on a GPU, and on a processor that plays one.
const SLOTS: [u32; 2] = [1 << 16, 1 << 12];
/// View rays that each slot of a GPU takes in a pass, about.
const RAYS_OF_SLOT: u64 = 8;
/// Tentative collisions of a path before it collides.
const TENTATIVES: u32 = 8;
/// Collisions of a path before the next path may begin, at most.
const EVENTS: u32 = 8;

/// What traces paths on a GPU.
pub struct Paths<'a> {
    gpu: &'a Gpu,
    rays: &'a Rays<'a>,
    scene: GpuScene,
    lights: Lights,
    maps: Maps,
    glow: Option<Glow>,
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
    pace: Cell<Pace>,
}

/// How much a dispatch does.
#[derive(Debug, Clone, Copy)]
struct Pace {
    steps: u32,
    /// Slots.
    width: u32,
}

impl Pace {
    /// What takes about as long as a dispatch should, after one took since `began`.
    fn after(self, began: Instant, slots: u32, most: u32) -> Self {
        let steps = pace::next(self.steps, began, most);
        match pace::factor(began) < 1.0 {
            true if self.steps == 1 => Pace { width: (self.width / 2).max(GROUP), ..self },
            false if self.width < slots => Pace { width: (2 * self.width).min(slots), ..self },
            _ => Pace { steps, ..self },
        }
    }
}

impl<'a> Paths<'a> {
    /// For a plan.
    pub fn new(gpu: &'a Gpu, rays: &'a Rays<'a>, connections: &Connections) -> Result<Self> {
        let Rays { plan, paths, window, images } = rays;
        let medium = &plan.scene.medium;
        let mut scene = GpuScene::new(gpu, plan.scene, plan.channels)?;
        let track = flights(plan);
        scene.update(gpu, |constants| {
            constants.seed = split(plan.settings.seed);
            constants.last = plan.orders;
            (constants.free_path, constants.block, constants.cells) = (track.free_path, track.block, track.cells);
        });
        let far = connections.far.iter().map(|light| (&light.view, light.check));
        let lights = Lights::new(gpu, far.chain(connections.near.iter().map(|view| (view, 1.0))))?;
        let maps = Maps::new(gpu, connections.maps.iter().copied())?;
        let glow = Glow::new(gpu, medium)?;
        let planes = medium.emission.as_ref().map_or(0, Emission::channels) as u32;
        let files = [files(plan, connections, glow.as_ref()), track.files].concat();
        let source = scene
            .source(&files)
            .with("PURPOSE", PATH)
            .with("UNLIMITED", plan.orders == u32::MAX)
            .with("STARTS", paths.starts as u32)
            .with("WALKED", u8::from(paths.walked))
            .with("FAR_LIGHTS", connections.far.len() as u32)
            .with("NEAR_LIGHTS", connections.near.len() as u32)
            .with("MAPS", maps.count)
            .with("SEES_OUT", u8::from(connections.has_background()))
            .with("FLIES_OUT", u8::from(connections.has_background() || planes > 0))
            .with("PLANES", planes);
        let source = track.constants.iter().fold(source, |source, (name, value)| source.with(name, *value));
        let effort = Iterations::new(rays, connections, planes, track.iterations).effort(gpu)?;
        let kernel = gpu.kernel(source.with("ROUNDS", effort.rounds).with("EVENTS", effort.events))?;
        let seen_at: Vec<Image> = images.iter().map(image).chain([Image::default()]).collect();
        let slots = SLOTS[usize::from(gpu.software)];
        let common = Job {
            resolution: plan.scene.camera.resolution.map(|m| m as u32),
            first: [window[0].0 as u32, window[1].0 as u32],
            columns: (window[0].1 - window[0].0) as u32,
            slots,
            background: connections.background,
            images: images.len() as u32,
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
            most: effort.steps,
            pace: Cell::new(Pace { steps: 1, width: slots }),
        })
    }

    /// What the view rays of a job see, 2 values of each channel for each, and the number of real collisions; `None` if it
    /// was halted.
    fn trace(&self, job: &Job, halted: &dyn Fn() -> bool) -> Result<Option<(Vec<f32>, u64)>> {
        let mut bindings = self.scene.bindings();
        bindings.extend(self.lights.bindings());
        bindings.extend(self.maps.bindings());
        bindings.extend(self.glow.iter().flat_map(Glow::bindings));
        bindings.extend(self.buffers.iter().map(|(name, buffer)| (*name, Binding::Buffer(buffer))));
        bindings.extend([
            ("job", Binding::Buffer(&self.job)),
            ("paths", Binding::Buffer(&self.state)),
            ("counters", Binding::Buffer(&self.counters)),
            ("seen", Binding::Buffer(&self.seen)),
        ]);
        self.gpu.clear(&self.state);
        let mut collisions = 0;
        let mut pace = self.pace.get();
        loop {
            self.gpu.clear(&self.counters);
            let mut slot = 0;
            while slot < job.slots {
                if halted() {
                    return Ok(None);
                }
                let end = job.slots.min(slot + pace.width);
                self.gpu.write(&self.job, 0, &[Job { steps: pace.steps, slot, end, ..*job }]);
                let began = Instant::now();
                self.gpu.run(&self.kernel, &bindings, u64::from(end - slot))?;
                pace = pace.after(began, self.common.slots, self.most);
                slot = end;
            }
            let counters = self.gpu.read::<u32>(&self.counters, 2)?;
            collisions += u64::from(counters[1]);
            if counters[0] == 0 {
                break;
            }
            // Those who come last say nothing about the pace of all.
            if counters[0] > job.slots / 2 {
                self.pace.set(pace);
            }
        }
        let values = 2 * self.rays.plan.channels * job.rays as usize;
        Ok(Some((self.gpu.read(&self.seen, values)?, collisions)))
    }
}

impl<const C: usize> Passes<C> for Paths<'_> {
    fn rays(&self, planned: u64) -> u64 {
        let pixels = self.rays.window.iter().map(|(first, end)| end.saturating_sub(*first)).product::<usize>();
        // Enough for slots not to wait for the last one.
        let filling = RAYS_OF_SLOT * u64::from(self.common.slots) / pixels.max(1) as u64;
        if self.gpu.software { planned } else { planned.max(filling).min(RAYS as u64) }
    }

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
            let Some((seen, met)) = self.trace(&job, &halted)? else { return Ok(collisions) };
            collisions += met;
            let (top, bottom) = (rows.0 + first / wide, rows.0 + (first + pixels).div_ceil(wide));
            sums[top * width..bottom * width].par_chunks_mut(width).enumerate().for_each(|(row, sums)| {
                for (column, sum) in sums[columns.0..columns.1].iter_mut().enumerate() {
                    let at = (first / wide + row) * wide + column;
                    let Some(at) = at.checked_sub(first).filter(|&at| at < pixels) else { continue };
                    for ray in seen[2 * C * count * at..2 * C * count * (at + 1)].chunks_exact(2 * C) {
                        let light = |from: usize| std::array::from_fn(|c| f64::from(ray[from + c]));
                        sum.add(light(0), light(C));
                    }
                }
            });
        }
        Ok(collisions)
    }
}

/// The flights of a plan, of which a path makes some between two collisions.
fn flights(plan: &Plan) -> Track {
    let (mut track, tentatives) = if plan.lanes {
        let course = Course::new(plan, Scored::Nowhere, PATH);
        (Track::by_events(&course), if course.certain { 1 } else { TENTATIVES })
    } else {
        (Track::new(plan, 0), 1)
    };
    track.constants.push(("TENTATIVES", f64::from(tentatives)));
    track.iterations *= tentatives;
    track
}

/// The shader files of a plan, apart from those of its flights.
fn files(plan: &Plan, connections: &Connections, glow: Option<&Glow>) -> Vec<&'static str> {
    let volume = &plan.scene.medium.volume;
    let mut files = vec!["path", "paths", "primary", "camera", "connect", "light", "flight_state", "face", "roulette"];
    files.push(if plan.lanes { "path_flights" } else { "path_tracker" });
    files.push(if plan.chromatic { "first_chromatic" } else { "first_grey" });
    files.push(if volume.is_constant() { "reach_constant" } else { "reach_voxels" });
    files.push(if connections.near.is_empty() { "near_none" } else { "near_lights" });
    files.extend(if connections.maps.is_empty() { &["maps_none"][..] } else { &["maps_some", "map"] });
    match glow {
        Some(glow) => {
            files.extend(["emits", glow.emission()]);
            files.push(if plan.chromatic { "emitted_chromatic" } else { "emitted_grey" });
        }
        None => files.push("emits_nothing"),
    }
    files
}

/// Loop iterations that the parts of a step take at most.
struct Iterations {
    /// Paths of a step, and events of each, that are of use.
    rounds: u32,
    events: u32,
    view: u32,
    start: u32,
    event: u32,
}

/// What a dispatch may do: steps, paths of a step, and events of each.
struct Effort {
    steps: u32,
    rounds: u32,
    events: u32,
}

impl Iterations {
    /// Those of a plan; a flight takes `flight`.
    fn new(rays: &Rays, connections: &Connections, planes: u32, flight: u32) -> Self {
        let volume = &rays.plan.scene.medium.volume;
        // Cells that a line crosses, and short loops.
        let across = volume.n().iter().sum::<usize>() as u32 + 16;
        let line = if volume.is_constant() { 16 } else { across };
        let map = |map: &&Map| line + map.size().iter().map(|m| 2 * m.ilog2()).sum::<u32>() + 2;
        // Each look into a table of the phase function.
        let look = if matches!(rays.plan.scene.medium.phase, Phase::Tabulated(_)) { 32 } else { 0 };
        let maps: u32 = connections.maps.iter().map(map).sum::<u32>() + look * connections.maps.len() as u32;
        let (far, near) = (connections.far.len() as u32, connections.near.len() as u32);
        // What is in closed form is worth no waiting.
        let (rounds, events) = if volume.is_constant() { (1, 2) } else { (rays.paths.starts as u32, EVENTS) };
        let lit = far * (2 * line + look) + near * (2 * line + 3 * look) + far + near;
        Iterations {
            rounds,
            events,
            view: line + rays.images.len() as u32,
            start: line + 24 + near * (3 * line + 2 * look + 2),
            event: 1 + flight + lit + maps + 2 * look + planes * across + line,
        }
    }

    /// What an adapter does in a dispatch.
    fn effort(&self, gpu: &Gpu) -> Result<Effort> {
        let step = |rounds, events| self.view + rounds * (1 + self.start + events * self.event);
        if !gpu.software {
            return Ok(Effort { steps: 256, rounds: self.rounds, events: self.events });
        }
        let tries = (1..=self.events).rev().map(|events| (self.rounds, events)).chain([(1, 1)]);
        for (rounds, events) in tries {
            if step(rounds, events) <= ITERATIONS {
                return Ok(Effort { steps: ITERATIONS / step(rounds, events), rounds, events });
            }
        }
        Err(Error::VolumeTooLarge(format!(
            "a collision may take {} steps through this volume, and the GPU {} allows {ITERATIONS}; use backend=\"cpu\"",
            step(1, 1),
            gpu.description.name
        )))
    }
}

/// Where a near light is seen.
fn image(place: &[f64; 2]) -> Image {
    // Those far off the image are near no pixel.
    let place = place.map(|c| c.clamp(-1e6, 1e6));
    Image { pixel: place.map(|c| c.floor() as i32), place: place.map(|c| (c - c.floor()) as f32) }
}

#[cfg(test)]
mod tests {
    use super::super::kernel::span;
    use super::super::kernels;
    use super::*;
    use crate::backend::Control;
    use crate::backend::views::{illuminations, light_grids};
    use crate::plan::{Method, Settings};
    use crate::scene::field::Field;
    use crate::scene::{Albedo, Camera, Light, Medium, Scene, Spectrum, Volume};

    #[test]
    fn slots_hold_a_path() {
        let spans = kernels().into_iter().filter(|kernel| kernel.files()[0] == "path");
        let spans = spans.filter_map(|kernel| span(&kernel, "Path"));
        assert_eq!(spans.max(), Some(STATE));
    }

    /// What view rays of a cloud see, from dispatches of one pace.
    fn seen(linear: bool, rays: Range<u64>, pace: Option<Pace>) -> Vec<f64> {
        let gpu = Gpu::open("").expect("an adapter");
        let n = [9usize, 8, 7];
        let density: Vec<f32> = (0..504).map(|i| ((i * 7919) % 101) as f32 / 100.0).collect();
        let grey = |v: f64| Spectrum::new(&[v], "value").expect("valid");
        let volume = Volume::new(&density, n, [0.1; 3], [0.0; 3], linear).expect("valid");
        let medium = Medium::new(volume, grey(20.0), Albedo::Constant(grey(0.99)), Phase::Isotropic).expect("valid");
        let lights = vec![
            Light::directional([0.0, 0.3, -1.0], &[1.0]).expect("valid"),
            Light::point([0.4, 0.3, 0.3], &[1.0]).expect("valid"),
        ];
        let camera = Camera::perspective([3.0, -3.0, 2.0], [0.4; 3], [0.0, 0.0, 1.0], 14.0, [13, 11]).expect("valid");
        let scene = Scene::new(medium, lights, camera);
        let settings = Settings { method: Some(Method::Path), fluence: false, radiance: false, ..Settings::default() };
        let plan = Plan::new(&scene, &settings).expect("a plan");
        let columns = light_grids(&plan, None, &Control::new(None));
        let views = illuminations(&scene, None, plan.lights.iter().map(|l| l.column), &columns);
        let connections = Connections::new(&plan, Field::density(&scene.medium.volume), &views);
        let all = Rays::new(&plan, &connections).expect("paths");
        let paths = Paths::new(&gpu, &all, &connections).expect("it compiles");
        let mut sums = vec![Sums::<1>::default(); 13 * 11];
        if let Some(pace) = pace {
            paths.pace.set(pace);
            let paths = Paths { most: pace.steps, ..paths };
            paths.take(rays, &mut sums, &|| false).expect("it runs");
        } else {
            paths.take(rays, &mut sums, &|| false).expect("it runs");
        }
        sums.iter().flat_map(Sums::values).collect()
    }

    #[test]
    fn bits_do_not_hang_on_dispatches() {
        for linear in [false, true] {
            let whole = seen(linear, 3..40, None);
            assert!(whole.iter().sum::<f64>() > 0.0);
            assert_eq!(whole, seen(linear, 3..40, Some(Pace { steps: 1, width: 512 })));
        }
    }
}
