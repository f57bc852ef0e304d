//! What a plan costs: bytes and seconds, estimated before anything runs.

use super::lights::{crossed, work_in_voxels};
use super::{Column, Direct, Emission, MajorantGrid, Plan, REPLICATES, Rays, Tracker};
use crate::error::{Error, Result};
use crate::scene::{Light, Scene};

/// Bytes by part.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Memory {
    /// (part, bytes), the input first.
    pub parts: Vec<(&'static str, u64)>,
}

impl Memory {
    /// The sum of all parts.
    pub fn total(&self) -> u64 {
        self.parts.iter().map(|p| p.1).sum()
    }
}

/// The memory that a plan takes.
pub fn memory(plan: &Plan) -> Memory {
    let volume = &plan.scene.medium.volume;
    let voxels = volume.voxels() as u64;
    let values = voxels * plan.channels as u64;
    let nodes: u64 = volume.n().iter().map(|&m| m as u64 + 2).product();
    let grids = light_grids(plan) as u64;
    let first = plan.lights.iter().filter(|l| l.emission == Emission::FirstCollision).count() as u64;
    let wants_fluence = u64::from(plan.settings.fluence);
    let found = wants_fluence + u64::from(plan.finds_absorbed());
    let wants_source = u64::from(plan.wants_source() && plan.paths.is_none());
    // Three sums in double precision, and a copy while a pass runs.
    let sums = if plan.paths.is_some() { 48 * pixels(plan) * plan.channels as u64 } else { 0 };
    let moments = if !plan.shoots() || !plan.keeps_moments() {
        0
    } else if plan.one_moment() {
        1
    } else {
        wants_fluence + wants_source
    } + u64::from(plan.absorbed.is_some());
    // Values and errors that a run keeps which looks at them.
    let judged = if plan.judges_fluence() { values * 8 * (found + u64::from(plan.settings.radiance)) } else { 0 };
    let mut parts = vec![
        ("density (input)", voxels * 4),
        ("emission (input)", voxels * 4 * plan.scene.medium.emission.as_ref().map_or(0, |e| e.channels() as u64)),
        ("maps of the sky", plan.scene.lights.iter().map(map_bytes).sum()),
        ("tally bins", values * 4 * (words(plan) * bin_sets(plan)) as u64),
        ("moments", values * 12 * moments),
        ("replicate volumes", values * 4 * (plan.sums() * plan.width()) as u64),
        ("light grids", nodes * 4 * grids),
        ("first collisions", voxels * 4 * first),
        ("image sums", sums),
        ("unscattered light", order0_bytes(plan) + judged),
        ("results", values * 4 * (found * 2 + wants_source * (2 + plan.width() as u64))),
    ];
    if plan.settings.adapter.is_some() {
        parts.push(("tally bins (GPU)", values * 8 * words(plan) as u64));
        parts.push(("density (GPU)", if volume.is_constant() { 0 } else { voxels * 4 }));
        parts.push(("first collisions (GPU)", voxels * 4 * first));
        parts.push(("light grids (GPU)", nodes * 4 * grids));
    }
    if let Some(grid) = &plan.majorant {
        parts.push(("majorant grid", grid.density.len() as u64 * 4));
    }
    parts.retain(|p| p.1 > 0);
    Memory { parts }
}

/// Sums of 64 bits of the rays of unscattered light, one set for each thread, beyond this many bytes are one set that all share.
pub const PRIVATE_SUMS: usize = 128 << 20;

/// Bytes of the sums and moments that find the unscattered light of one light.
fn order0_bytes(plan: &Plan) -> u64 {
    let voxels = plan.settings.fluence || plan.settings.radiance;
    if plan.paths.is_some() || !voxels || !plan.lights.iter().any(|l| matches!(l.direct, Direct::Rays(_))) {
        return 0;
    }
    let medium = &plan.scene.medium;
    let seen = plan.settings.radiance && plan.wants_source() && !medium.phase.is_isotropic();
    let values = medium.volume.voxels() * if plan.chromatic { 3 } else { 1 };
    let tallies = 1 + usize::from(plan.finds_absorbed()) + usize::from(seen);
    let sets = threads(plan.settings.threads);
    let sets = if values * tallies * sets * 8 <= PRIVATE_SUMS { sets } else { 1 };
    (values * tallies * (8 * sets + 12)) as u64
}

/// Pixels of the plan's camera.
fn pixels(plan: &Plan) -> u64 {
    plan.scene.camera.resolution.iter().map(|&r| r as u64).product()
}

/// Paths that the run takes at least.
pub fn paths(plan: &Plan) -> u64 {
    plan.paths.as_ref().map_or(0, |paths| pixels(plan) * paths.starts * paths.rays.unwrap_or(paths.pass))
}

/// Tally bins of all threads beyond this are shared.
const PRIVATE_BINS: usize = 128 << 20;

/// Bytes of the map of a light and of the tables that its directions are drawn from.
fn map_bytes(light: &Light) -> u64 {
    match light {
        Light::Environment { map: Some(map), .. } => {
            map.size().iter().map(|&m| m as u64).product::<u64>() * (4 * map.channels() as u64 + 16)
        }
        _ => 0,
    }
}

/// Number of light grids.
fn light_grids(plan: &Plan) -> usize {
    let constant = plan.scene.medium.volume.is_constant();
    plan.lights.iter().zip(&plan.scene.lights).filter(|(l, light)| uses_grid(l, light, constant)).count()
}

/// Words of all layers per voxel and channel.
fn words(plan: &Plan) -> usize {
    plan.layers.iter().map(|&layer| plan.width_of(layer)).sum()
}

/// Sets of bins per layer: one per thread while they are small, which spares locked additions; else one.
pub fn bin_sets(plan: &Plan) -> usize {
    if plan.settings.adapter.is_some() {
        return 1;
    }
    let sets = threads(plan.settings.threads);
    let bytes = plan.scene.medium.volume.voxels() * plan.channels * 4 * words(plan);
    if bytes * sets <= PRIVATE_BINS { sets } else { 1 }
}

/// Whether a light keeps a grid of column densities.
pub fn uses_grid(plan: &super::LightPlan, light: &Light, constant: bool) -> bool {
    !constant
        && matches!(light, Light::Point { .. } | Light::Directional { .. })
        && (plan.column == Column::Grid || plan.emission == Emission::FirstCollision)
}

/// Refuses a plan that does not fit, unless forced.
pub fn check_memory(plan: &Plan) -> Result<()> {
    let (need, free) = (plan.memory.total(), available());
    match free {
        Some(free) if need > free && !plan.settings.force => {
            let largest = plan.memory.parts.iter().max_by_key(|p| p.1).map_or("", |p| p.0);
            Err(Error::VolumeTooLarge(format!(
                "the run needs {:.2} GiB (most for {largest}), {:.2} GiB are free; errors=False spares the replicate \
                 volumes, outputs=(\"image\",) the voxel outputs, force=True runs all the same",
                gib(need),
                gib(free)
            )))
        }
        _ => Ok(()),
    }
}

/// Buffers that the tallies may be split into on a GPU.
pub const TALLY_PARTS: u64 = 4;

/// Refuses a plan that the adapter cannot hold.
pub fn check_adapter(plan: &Plan) -> Result<()> {
    let Some(adapter) = &plan.settings.adapter else { return Ok(()) };
    let n = plan.scene.medium.volume.n();
    let refuse = |what: String| Err(Error::VolumeTooLarge(format!("{what}; use backend=\"cpu\"")));
    if n.iter().any(|&m| m + 2 > adapter.extent as usize) {
        return refuse(format!(
            "the volume's shape (nz, ny, nx) = ({}, {}, {}) is too large for the GPU {}, whose textures hold up to {} \
             voxels along each axis",
            n[2],
            n[1],
            n[0],
            adapter.name,
            adapter.extent - 2
        ));
    }
    let bins = (plan.scene.medium.volume.voxels() * plan.channels * words(plan)) as u64;
    let most = (adapter.binding / 4 * TALLY_PARTS).min(u64::from(u32::MAX));
    if bins > most {
        return refuse(format!(
            "the run tallies {bins} values, and the GPU {} holds {most} of them; outputs=(\"image\",) or fewer \
             channels would need less",
            adapter.name
        ));
    }
    Ok(())
}

/// Refuses an image that does not fit: `values` numbers per pixel.
pub fn check_image(pixels: u64, values: u64) -> Result<()> {
    let need = pixels * values * 4;
    match available() {
        Some(free) if need > free => Err(Error::VolumeTooLarge(format!(
            "an image of {pixels} pixels needs {:.2} GiB, {:.2} GiB are free",
            gib(need),
            gib(free)
        ))),
        _ => Ok(()),
    }
}

fn gib(bytes: u64) -> f64 {
    bytes as f64 / (1u64 << 30) as f64
}

/// Memory that the system says is available, where it says so.
fn available() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find(|l| l.starts_with("MemAvailable:"))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib * 1024)
}

/// Number of threads that a run uses.
pub fn threads(given: Option<usize>) -> usize {
    given.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, std::num::NonZero::get))
}

/// Photons per second that the walk is expected to make: the mean chord's optical depth gives the flights, the tracker
/// the cost of each.
pub fn photons_per_second(
    scene: &Scene,
    orders: u32,
    tracker: Tracker,
    grid: Option<&MajorantGrid>,
    lanes: bool,
    given: Option<usize>,
) -> f64 {
    let medium = &scene.medium;
    let volume = &medium.volume;
    let chord = 4.0 * volume.size().iter().product::<f64>() / volume.surface();
    let depth = medium.extinction.max() * volume.mean() * chord;
    let escape = (-depth).exp().max(1.0 / (1.0 + depth * depth));
    let flights = (1.0 / (1.0 - medium.max_albedo() * (1.0 - escape)).max(1e-6)).min(f64::from(orders) + 1.0);
    let h = 3.0 / volume.spacing().iter().map(|h| 1.0 / h).sum::<f64>();
    let voxels = (chord / h).min(1.0 / (medium.extinction.max() * volume.mean()).max(1e-30) / h);
    let flight = match (tracker, grid) {
        (Tracker::Analytic, _) => 30.0,
        (Tracker::March, _) => 30.0 + voxels * if volume.linear() { 40.0 } else { 8.0 },
        (Tracker::Woodcock, Some(g)) => {
            let mean = g.density.iter().map(|&d| f64::from(d)).sum::<f64>() / g.density.len() as f64;
            30.0 + voxels * (10.0 / g.block as f64 + 25.0 * mean * medium.extinction.max() * h)
        }
        (Tracker::Woodcock, None) => 30.0,
    };
    // Lanes measure three to five times as fast.
    let lanes = if lanes { 4.0 } else { 1.0 };
    lanes * threads(given) as f64 * 1e9 / (60.0 + flights * (40.0 + flight))
}

/// Seconds that the run is expected to take; with a target error it is not known before, and the least is given.
pub fn seconds(plan: &Plan) -> f64 {
    let volume = &plan.scene.medium.volume;
    let threads = threads(plan.settings.threads) as f64;
    let grids = light_grids(plan) as f64;
    // Unscattered light in voxels is found with the run only if that judges their error.
    let rays: f64 = plan
        .lights
        .iter()
        .zip(&plan.scene.lights)
        .map(|(how, light)| match how.direct {
            Direct::Rays(Rays { lattice, sparse }) if plan.judges_fluence() => {
                let all = (REPLICATES * lattice.points()) as f64 * crossed(volume, light) * work_in_voxels(plan.scene);
                if sparse { all / 3.0 } else { all }
            }
            _ => 0.0,
        })
        .sum();
    // A sweep reads each voxel a few times; between voxel centres a ray has two pieces to a voxel.
    let crossing = if volume.linear() { 25e-9 } else { 12e-9 };
    let light = (volume.voxels() as f64 * 45e-9 * grids + rays * crossing) / threads;
    let batches = plan.batches.unwrap_or(plan.subvolumes.max(16) as u64);
    let photons = (plan.batch_photons * batches) as f64 / plan.photons_per_second;
    let folds = batches as f64 * volume.voxels() as f64 * plan.channels as f64 * 5e-9 / threads;
    let photons = photons + paths(plan) as f64 / plan.photons_per_second;
    let run = light + photons + if plan.shoots() { folds } else { 0.0 };
    let open = plan.batches.is_none() || plan.paths.as_ref().is_some_and(|paths| paths.rays.is_none());
    match (open, plan.settings.time_limit) {
        (true, Some(limit)) => run.max(limit),
        _ => run,
    }
}
