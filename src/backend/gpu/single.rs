//! Unscattered light in the voxels, on the GPU: a light's means over the voxels, some rows of them at a time.

use super::device::Gpu;
use super::kernel::{Binding, Kernel};
use super::lights::Lights;
use super::pace;
use super::scene::GpuScene;
use crate::backend::Control;
use crate::backend::cpu::light::{Illumination, PIECES, Quadrature, Source, is_next_to};
use crate::backend::single::Lit;
use crate::error::{Error, Result};
use crate::plan::Plan;
use bytemuck::{Pod, Zeroable};
use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

/// `Job` of `shaders/single.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[expect(missing_docs, reason = "the shader names and describes them")]
pub struct Job {
    pub first: u32,
    pub count: u32,
    pub points: u32,
    pub rays: u32,
    pub most: u32,
    pub begins: u32,
    pub reach: f32,
    pub side: f32,
}

/// `Progress` of `shaders/single.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[expect(missing_docs, reason = "the shader names and describes them")]
pub struct Progress {
    pub at: u32,
    pub points: u32,
    pub shift: f32,
    pub spare: u32,
}

/// `Job` of `shaders/near.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[expect(missing_docs, reason = "the shader names and describes them")]
pub struct NearJob {
    pub low: [i32; 3],
    pub count: u32,
    pub size: [u32; 3],
    pub spare: u32,
}

/// Voxels of a dispatch at most.
const VOXELS: usize = 1 << 16;
/// Cells that the rays of a dispatch cross, and those of one invocation.
const CELLS: usize = 1 << 25;
const CELLS_OF_ONE: usize = 30_000;

/// A light of the quadrature.
#[derive(Debug)]
struct Light {
    lights: Lights,
    points: usize,
    rays: bool,
    reach: f32,
    /// Cells that are crossed for a point.
    cells: usize,
    /// Voxels next to it.
    near: HashMap<usize, Quadrature>,
}

/// The means over voxels of all lights, some rows along x at a time.
#[derive(Debug)]
pub struct Quadratures<'a> {
    gpu: &'a Gpu,
    scene: GpuScene,
    kernel: Arc<Kernel>,
    lights: Vec<Light>,
    progress: wgpu::Buffer,
    unfinished: wgpu::Buffer,
    means: wgpu::Buffer,
    job: wgpu::Buffer,
    channels: usize,
    /// Whether collisions are wanted.
    collisions: bool,
    n: [usize; 3],
    side: f32,
    /// Voxels of a dispatch at most, and cells that its rays cross.
    voxels: usize,
    cells: usize,
    /// The rows that are found, and the means in them of each light.
    rows: Range<usize>,
    found: Vec<Vec<f32>>,
}

impl<'a> Quadratures<'a> {
    /// Uploads the scene and the lights, and finds the voxels next to these.
    pub fn new(gpu: &'a Gpu, plan: &Plan, lights: &[Lit], collisions: bool, control: &Control) -> Result<Self> {
        Self::cut(gpu, plan, lights, collisions, [VOXELS, CELLS], control)
    }

    /// The same with at most so many voxels in a dispatch, the rays of which cross so many cells.
    fn cut(
        gpu: &'a Gpu,
        plan: &Plan,
        lights: &[Lit],
        collisions: bool,
        [voxels, cells]: [usize; 2],
        control: &Control,
    ) -> Result<Self> {
        let volume = &plan.scene.medium.volume;
        let (channels, n) = (plan.channels, volume.n());
        let scene = GpuScene::new(gpu, plan.scene, channels)?;
        let kernel = gpu.kernel(scene.source(&["single", "light"]))?;
        let across = n.iter().sum::<usize>() + 8;
        let lights = lights
            .iter()
            .map(|lit| {
                let on_gpu = Lights::new(gpu, std::iter::once((lit.view, 1.0)))?;
                // Light grids that do not fit are not there: then rays find every depth.
                let has_grid = lit.view.grid().is_some() && lit.view.layers()[2] <= gpu.description.extent as usize;
                let walks = !volume.is_constant() && (lit.rays || !has_grid);
                let near = near(gpu, &scene, &on_gpu, lit.view, n, channels, control)?;
                let cells = if walks { across } else { 4 };
                let (points, rays, reach) = (lit.points, lit.rays, lit.view.reach());
                Ok(Light { lights: on_gpu, points, rays, reach, cells, near })
            })
            .collect::<Result<Vec<_>>>()?;
        let most = (voxels / n[0]).max(1) * n[0];
        Ok(Quadratures {
            gpu,
            kernel,
            lights,
            progress: gpu.empty((most * size_of::<Progress>()) as u64)?,
            unfinished: gpu.empty(4)?,
            means: gpu.empty((most * 2 * channels * 4) as u64)?,
            job: gpu.uniform(&Job::default())?,
            scene,
            channels,
            collisions,
            n,
            side: volume.spacing().into_iter().fold(0.0, |m, h| (h as f32).max(m)),
            voxels,
            cells,
            rows: 0..0,
            found: Vec::new(),
        })
    }

    /// Finds the next rows along x; `None` after the last.
    pub fn next_rows(&mut self, control: &Control) -> Result<Option<Range<usize>>> {
        let [nx, ny, nz] = self.n;
        let first = self.rows.end;
        if first == ny * nz {
            return Ok(None);
        }
        self.rows = first..(first + (self.voxels / nx).max(1)).min(ny * nz);
        self.found = self.lights.iter().map(|light| self.means(light, control)).collect::<Result<_>>()?;
        Ok(Some(self.rows.clone()))
    }

    /// The means of a light over the rows' voxels.
    fn means(&self, light: &Light, control: &Control) -> Result<Vec<f32>> {
        let gpu = self.gpu;
        let count = self.rows.len() * self.n[0];
        let mut bindings = self.scene.bindings();
        bindings.extend(light.lights.bindings());
        let own = [
            ("job", &self.job),
            ("progress", &self.progress),
            ("unfinished", &self.unfinished),
            ("means", &self.means),
        ];
        bindings.extend(own.map(|(name, buffer)| (name, Binding::Buffer(buffer))));
        let limit = (CELLS_OF_ONE / light.cells).max(1) as u32;
        let mut most = ((self.cells / (count * light.cells)) as u32).clamp(1, limit);
        let (mut from, all) = (0, light.points.pow(3) as u32);
        while from < all {
            if control.stopped() {
                return Err(Error::Interrupted);
            }
            let job = Job {
                first: (self.rows.start * self.n[0]) as u32,
                count: count as u32,
                points: light.points as u32,
                rays: u32::from(light.rays),
                most,
                begins: u32::from(from == 0),
                reach: light.reach,
                side: self.side,
            };
            gpu.write(&self.job, 0, &[job]);
            gpu.clear(&self.unfinished);
            let began = Instant::now();
            gpu.run(&self.kernel, &bindings, count as u64)?;
            from += most;
            most = pace::next(most, began, limit);
            // Few voxels need as many points as the densest.
            if from < all && gpu.read::<u32>(&self.unfinished, 1)?[0] == 0 {
                break;
            }
        }
        gpu.read(&self.means, count * self.channels * if self.collisions { 2 } else { 1 })
    }

    /// The means of the light `at` over a voxel of the rows that were found last.
    pub fn of(&self, at: usize, cell: [usize; 3]) -> Quadrature {
        let voxel = (cell[2] * self.n[1] + cell[1]) * self.n[0] + cell[0];
        if let Some(quadrature) = self.lights[at].near.get(&voxel) {
            return *quadrature;
        }
        let (count, i) = (self.rows.len() * self.n[0], voxel - self.rows.start * self.n[0]);
        let plane = |plane: usize| self.found[at].get(plane * count + i).copied().unwrap_or(0.0);
        let channel = |c: usize| c.min(self.channels - 1);
        Quadrature {
            fluence: std::array::from_fn(|c| plane(channel(c))),
            collisions: std::array::from_fn(|c| plane(self.channels + channel(c))),
        }
    }
}

/// The means over the voxels next to a light.
fn near(
    gpu: &Gpu,
    scene: &GpuScene,
    lights: &Lights,
    view: &Illumination,
    n: [usize; 3],
    channels: usize,
    control: &Control,
) -> Result<HashMap<usize, Quadrature>> {
    let mut list = HashMap::new();
    let Source::Point(position) = view.source else { return Ok(list) };
    // The voxels within 3 of it, or one more.
    let low: [i32; 3] = std::array::from_fn(|a| (position[a] - 3.5).clamp(0.0, n[a] as f32) as i32);
    let high: [i32; 3] = std::array::from_fn(|a| (position[a] + 3.5).clamp(0.0, n[a] as f32) as i32);
    let size: [u32; 3] = std::array::from_fn(|a| (high[a] - low[a]) as u32);
    let voxels = size.iter().product::<u32>() as usize;
    if voxels == 0 {
        return Ok(list);
    }
    if control.stopped() {
        return Err(Error::Interrupted);
    }
    let each = 6 * PIECES * PIECES;
    let job = NearJob { low, count: (voxels * each) as u32, size, spare: 0 };
    let (job, output) = (gpu.uniform(&job)?, gpu.empty((voxels * each * channels * 4) as u64)?);
    let mut bindings = scene.bindings();
    bindings.extend(lights.bindings());
    bindings.extend([("job", Binding::Buffer(&job)), ("pieces", Binding::Buffer(&output))]);
    gpu.run(&*gpu.kernel(scene.source(&["near", "light"]))?, &bindings, (voxels * each) as u64)?;
    let pieces: Vec<f32> = gpu.read(&output, voxels * each * channels)?;
    let volume = scene.constants.h.iter().map(|&h| f64::from(h)).product::<f64>();
    for (at, pieces) in pieces.chunks(each * channels).enumerate() {
        let at = [at % size[0] as usize, at / size[0] as usize % size[1] as usize, at / (size[0] * size[1]) as usize];
        let cell: [i32; 3] = std::array::from_fn(|a| low[a] + at[a] as i32);
        if !is_next_to(view, cell) {
            continue;
        }
        let sum = |c: usize| pieces.iter().skip(c).step_by(channels).map(|&piece| f64::from(piece)).sum::<f64>();
        let fluence = std::array::from_fn(|c| (sum(c.min(channels - 1)) / volume * f64::from(view.value[c])) as f32);
        let density = view.density(cell.map(|c| c as f32 + 0.5));
        let voxel = cell.map(|c| c as usize);
        list.insert(
            (voxel[2] * n[1] + voxel[1]) * n[0] + voxel[0],
            Quadrature { fluence, collisions: fluence.map(|f| f * density) },
        );
    }
    Ok(list)
}

#[cfg(test)]
mod tests;
