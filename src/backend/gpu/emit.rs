//! Emitters on the GPU: where photons start, as constants and tables.

use super::device::Gpu;
use super::glow::Glow;
use super::kernel::{Binding, Source};
use super::lights::Lights;
use super::map::Maps;
use crate::backend::cpu::emit::{Emitter, Kind, sum_of};
use crate::error::Result;
use crate::scene::Scene;
use bytemuck::{Pod, Zeroable};

/// `Emitter` of `shaders/start.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[expect(missing_docs, reason = "the shader names and describes them")]
pub struct Constants {
    pub step: [u32; 2],
    pub first: [u32; 2],
    pub colour: [f32; 3],
    pub count: u32,
    pub place: [f32; 3],
    pub distance: f32,
    pub axis: [f32; 3],
    pub cap: f32,
    pub faces: [f32; 3],
    pub scale: f32,
    pub below_x: [u32; 2],
    pub below_y: [u32; 2],
    pub rows: u32,
    pub width: u32,
    pub height: u32,
    pub spare: u32,
    pub factors: [f32; 3],
    pub padding: u32,
}

/// An emitter's constants and tables on the GPU.
#[derive(Debug)]
pub struct Start {
    /// What does not change from batch to batch.
    constants: Constants,
    uniform: wgpu::Buffer,
    table: Option<(wgpu::Buffer, wgpu::TextureView)>,
    lights: Option<Lights>,
    maps: Option<Maps>,
    glow: Option<Glow>,
    /// The shader files of its kind.
    pub files: Vec<&'static str>,
    /// Its constant that decides on branches: one of the kernel, for lavapipe compiles kernels anew at each dispatch, and
    /// keeps them all, where uniforms alone decide.
    branch: Option<(&'static str, bool)>,
    /// Loop iterations that a start may take.
    pub iterations: u32,
    /// The power of its photons [W], by channel.
    pub powers: [f64; 3],
    /// What the weight of a photon of each channel is multiplied by, where the mean photon has the weight 1.
    colour: [f32; 3],
    /// Whether its order 0 is tallied.
    pub tallies_unscattered: bool,
}

/// A part of the whole, in 2^-64.
fn part(x: f64) -> u64 {
    (x * 18_446_744_073_709_551_616.0) as u64
}

/// A number as two words, the lower first.
fn split(x: u64) -> [u32; 2] {
    [x as u32, (x >> 32) as u32]
}

/// The tables of `shaders/table.wgsl`: the ends of rows from running sums of their masses, and those of the cells of each
/// from the masses. The last of what has any mass ends at the end.
fn tables(sums: &[f64], width: usize, mass: impl Fn(usize) -> f64) -> (Vec<[u32; 2]>, Vec<u32>) {
    let total = sums.last().copied().unwrap_or(0.0);
    let last = sums.iter().position(|&sum| sum >= total).unwrap_or(0);
    let rows = sums.iter().enumerate().map(|(row, sum)| if row >= last { u64::MAX } else { part(sum / total) });
    let mut cells = Vec::with_capacity(sums.len() * width);
    for row in 0..sums.len() {
        let masses = || (0..width).map(|i| mass(row * width + i));
        let whole: f64 = masses().sum();
        let end = masses().enumerate().filter(|(_, m)| *m > 0.0).last().map_or(0, |(i, _)| i);
        let mut sum = 0.0;
        cells.extend(masses().enumerate().map(|(i, m)| {
            sum += m;
            if i >= end { u32::MAX } else { (sum / whole.max(1e-300) * 4_294_967_296.0) as u32 }
        }));
    }
    (rows.map(split).collect(), cells)
}

/// How many channels with power were drawn by together: weights are parts of their sum.
fn lit(factors: [f32; 3]) -> [f32; 3] {
    [factors.iter().filter(|&&factor| factor > 0.0).count() as f32; 3]
}

/// A voxel coordinate in single precision, which stays on its side of the faces at 0 and `n`, or on a face.
fn on_its_side(p: f64, n: f64) -> f32 {
    let (single, top) = (p as f32, n as f32);
    match p {
        p if p < 0.0 => single.min(-f32::MIN_POSITIVE),
        p if p > n => single.max(top.next_up()),
        p if p > 0.0 && p < n => single.clamp(f32::MIN_POSITIVE, top.next_down()),
        _ => single,
    }
}

impl Start {
    /// Uploads an emitter.
    pub fn new(gpu: &Gpu, scene: &Scene, emitter: &Emitter) -> Result<Self> {
        let volume = &scene.medium.volume;
        let (size, n) = (volume.size(), volume.n());
        let single = |v: [f64; 3]| v.map(|c| c as f32);
        let mut constants = Constants::default();
        let mut files = vec!["start"];
        let (mut table, mut lights, mut maps, mut glow) = (None, None, None, None);
        let (mut colour, mut iterations, mut branch) = ([1.0; 3], 0, None);
        let (mut rows, mut columns, mut height) = (n[1] * n[2], n[0], n[1]);
        let mut faces = |areas: &[f64; 3]| {
            let total = areas.iter().sum::<f64>();
            constants.below_x = split(part(areas[0] / total));
            constants.below_y = split(if areas[2] > 0.0 { part((areas[0] + areas[1]) / total) } else { u64::MAX });
            if areas[1] + areas[2] == 0.0 {
                constants.below_x = [u32::MAX; 2];
            }
            constants.faces = single(*areas);
        };
        match &emitter.kind {
            Kind::Point { position, axis, cap } => {
                files.push("start_point");
                let to: [f64; 3] = std::array::from_fn(|a| 0.5 * size[a] - position[a]);
                // Farther than two radii of the bounding sphere, where its own place is less exact than the box's centre.
                let outside = to.iter().map(|c| c * c).sum::<f64>() > size.iter().map(|s| s * s).sum::<f64>();
                constants.distance = if outside { to.iter().map(|c| c * c).sum::<f64>().sqrt() as f32 } else { 0.0 };
                constants.place = if outside {
                    single(size.map(|s| 0.5 * s))
                } else {
                    std::array::from_fn(|a| on_its_side(position[a] / volume.spacing()[a], n[a] as f64))
                };
                branch = Some(("OUTSIDE", outside));
                constants.axis = single(*axis);
                constants.cap = *cap as f32;
            }
            Kind::Pencil { p, direction } => {
                files.push("start_pencil");
                (constants.place, constants.axis) = (*p, single(*direction));
            }
            Kind::Directional { direction, faces: areas } => {
                files.push("start_directional");
                faces(areas);
                constants.axis = single(*direction);
            }
            Kind::Environment { faces: areas } => {
                files.push("start_environment");
                faces(areas);
            }
            Kind::FirstCollision(first) => {
                files.extend(["start_first", "table", "light"]);
                table = Some(tables(&first.rows, n[0], |at| f64::from(first.power[at])));
                lights = Some(Lights::new(gpu, std::iter::once((&first.light, 1.0)))?);
                branch = Some(("INTERPOLATED", first.interpolated));
                constants.scale = (f64::from(first.volume) / first.rows[first.rows.len() - 1]) as f32;
                colour = first.factors;
                iterations = 64 + if volume.is_constant() { 0 } else { (n.iter().sum::<usize>() + 8) as u32 };
            }
            Kind::Medium(glowing) => {
                files.extend(["start_medium", "table"]);
                glow = Glow::new(gpu, &scene.medium)?;
                files.extend(glow.iter().map(Glow::emission));
                table = Some(tables(&glowing.rows, n[0], |at| sum_of(&glowing.fields, &glowing.factors, at)));
                constants.factors = glowing.factors;
                colour = lit(glowing.factors);
                branch = Some(("GREY", glowing.fields.len() == 1));
                iterations = 64;
            }
            Kind::Map { shower, faces: areas } => {
                files.extend(["start_map", "table", "map"]);
                let (bounds, [width, lines]) = (shower.bounds(), shower.map().size());
                table = Some(tables(bounds.rows(), width, |at| bounds.mass(at / width, at % width)));
                maps = Some(Maps::new(gpu, std::iter::once(shower.map()))?);
                constants.faces = single(*areas);
                constants.distance = bounds.total() as f32;
                constants.factors = shower.factors();
                colour = lit(shower.factors());
                (rows, columns, height) = (lines, width, lines);
                iterations = 32 * 64;
            }
        }
        (constants.rows, constants.width, constants.height) = (rows as u32, columns as u32, height as u32);
        let table = match table {
            Some((ends, cells)) => {
                let n = [columns, height, rows / height];
                Some((gpu.buffer(&ends)?, gpu.texture(n, wgpu::TextureFormat::R32Uint, bytemuck::cast_slice(&cells))?))
            }
            None => None,
        };
        let uniform = gpu.uniform(&constants)?;
        Ok(Start {
            constants,
            uniform,
            table,
            lights,
            maps,
            glow,
            files,
            branch,
            iterations,
            powers: emitter.powers,
            colour,
            tallies_unscattered: emitter.tallies_unscattered,
        })
    }

    /// Sets out for a batch: `count` photons from number `first` on, each of `scale` times the mean photon's power, by
    /// channel.
    pub fn begin(&self, gpu: &Gpu, first: u64, count: u64, scale: [f32; 3]) {
        // 2^64 / count, rounded down.
        let step = ((1u128 << 64) / u128::from(count)).min(u128::from(u64::MAX)) as u64;
        let constants = Constants {
            step: split(step),
            first: split(first),
            count: count as u32,
            colour: std::array::from_fn(|c| self.colour[c] * scale[c]),
            ..self.constants
        };
        gpu.write(&self.uniform, 0, &[constants]);
    }

    /// Sets the constants of a kernel with its files.
    pub fn set(&self, source: Source) -> Source {
        self.branch.iter().fold(source, |source, (name, value)| source.with(name, *value))
    }

    /// For kernels.
    pub fn bindings(&self) -> Vec<(&'static str, Binding<'_>)> {
        let mut list = vec![("emitter", Binding::Buffer(&self.uniform))];
        if let Some((rows, cells)) = &self.table {
            list.extend([("row_ends", Binding::Buffer(rows)), ("cell_ends", Binding::Texture(cells))]);
        }
        list.extend(self.lights.iter().flat_map(Lights::bindings));
        list.extend(self.maps.iter().flat_map(Maps::bindings));
        list.extend(self.glow.iter().flat_map(Glow::bindings));
        list
    }
}
