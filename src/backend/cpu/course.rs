//! What flights in lanes run through: the density, its majorants, and where there is nothing.

use super::collision_medium::Medium;
use crate::physics::Phase;
use crate::physics::rng::split;
use crate::plan::{LEAST_SCORED_DEPTH, MajorantGrid, Plan, Tracker};
use crate::scene::field::Field;
use crate::scene::{Volume, block_maxima};

/// What flights leave at their tentative collisions, for which majorants must be high enough.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scored {
    /// Nothing.
    Nowhere,
    /// A score in voxels that the gather reads.
    ForImages,
    /// A score in every voxel.
    Everywhere,
}

/// What flights run through.
pub struct Course<'a> {
    /// The density.
    pub field: Field<'a>,
    /// Albedo and spacing.
    pub medium: Medium<'a>,
    /// The phase function.
    pub phase: &'a Phase,
    /// Whether every tentative collision is real.
    pub certain: bool,
    /// The majorants, where there are several.
    pub cells: Option<Cells>,
    /// Where nothing can collide, if that is looked up.
    pub voids: Option<Voids>,
    pub(super) isotropic: bool,
    /// 1 / majorant [length], where there is one majorant.
    pub(super) free_path: f32,
    /// The largest extinction coefficient per density.
    pub(super) extinction: f32,
    /// The key of all random numbers.
    pub seed: [u32; 2],
    /// What their numbers are for.
    pub(super) purpose: u32,
}

impl<'a> Course<'a> {
    /// From a plan.
    pub fn new(plan: &'a Plan<'a>, scored: Scored, purpose: u32) -> Self {
        let medium = &plan.scene.medium;
        let h = medium.volume.spacing().into_iter().fold(f64::INFINITY, f64::min);
        let sigma_t = medium.max_sigma_t();
        let least = if scored == Scored::Everywhere { LEAST_SCORED_DEPTH / h } else { 0.0 };
        let certain = plan.tracker == Tracker::Analytic && sigma_t >= least;
        // Rounded up, so that no acceptance exceeds one.
        let majorant = if certain { sigma_t } else { sigma_t.max(least) * (1.0 + 1e-6) };
        let grid = plan.majorant.as_ref().filter(|grid| !grid.is_one());
        // Cells have no collisions in voids anyway, and a homogeneous medium has no voids.
        let voids = if grid.is_some() || medium.volume.is_constant() { None } else { Voids::new(&medium.volume) };
        Course {
            field: Field::density(&medium.volume),
            medium: Medium::new(plan.scene),
            phase: &medium.phase,
            isotropic: medium.phase.is_isotropic(),
            certain,
            free_path: (1.0 / majorant.max(1e-30)) as f32,
            extinction: medium.extinction.max() as f32,
            cells: grid.map(|grid| Cells::new(plan, grid, least, scored != Scored::Nowhere)),
            voids,
            seed: split(plan.settings.seed),
            purpose,
        }
    }
}

impl Course<'_> {
    /// 1 / majorant, where there is one [length].
    pub fn free_path(&self) -> f32 {
        self.free_path
    }

    /// Voxels per cell and axis, cells along x, y, z, and majorants, where there are several.
    pub fn majorants(&self) -> Option<(f32, [i32; 3], &[f32])> {
        self.cells.as_ref().map(|cells| (cells.block, cells.n, &cells.majorant[..]))
    }
}

/// A grid of majorants.
pub struct Cells {
    /// Voxels per cell and axis.
    pub(super) block: f32,
    pub(super) n: [i32; 3],
    /// Extinction coefficients that are nowhere exceeded, x fastest.
    pub(super) majorant: Vec<f32>,
}

impl Cells {
    /// The plan's grid, raised to `least`. For images alone it is raised where the medium is empty but near enough to some
    /// density for the gather to interpolate the source there.
    fn new(plan: &Plan, grid: &MajorantGrid, least: f64, images: bool) -> Self {
        let medium = &plan.scene.medium;
        let near = block_maxima(&medium.volume, grid.block, Voids::REACH);
        let h = medium.volume.spacing().into_iter().fold(f64::INFINITY, f64::min);
        let majorant = grid.density.iter().zip(near).map(|(&density, near)| {
            let [own, near] = [density, 0.25 * near].map(|d| f64::from(d) * medium.extinction.max());
            (own.max(if images { near.min(LEAST_SCORED_DEPTH / h) } else { 0.0 }).max(least) * (1.0 + 1e-6)) as f32
        });
        Cells { block: grid.block as f32, n: grid.n.map(|m| m as i32), majorant: majorant.collect() }
    }
}

/// Cells of the volume that hold no density, nor have any next to them that an interpolation reads.
pub struct Voids {
    /// Cells are cubes of 2^shift voxels.
    pub(super) shift: u32,
    pub(super) n: [u32; 2],
    pub(super) empty: Vec<bool>,
}

impl Voids {
    /// Voxels around a cell that an image's interpolation of the source reads, and what the density's own does.
    const REACH: usize = 2;
    /// So many cells stay in the fastest cache.
    const CELLS: usize = 1 << 15;

    /// The voids of a volume, if it has any.
    fn new(volume: &Volume) -> Option<Self> {
        let cells = |shift: u32| volume.n().map(|m| m.div_ceil(1 << shift));
        let shift = (2..16).find(|&shift| cells(shift).iter().product::<usize>() <= Voids::CELLS).unwrap_or(16);
        let maxima = block_maxima(volume, 1 << shift, Voids::REACH);
        let n = cells(shift);
        let empty: Vec<bool> = maxima.iter().map(|&d| d == 0.0).collect();
        empty.contains(&true).then_some(Voids { shift, n: [n[0] as u32, n[1] as u32], empty })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::rng::{Draws, uniform};
    use crate::plan::Settings;
    use crate::scene::field::V3;
    use crate::scene::{Albedo, Camera, Light, Medium as Matter, Scene, Spectrum};

    #[test]
    fn majorants_are_nowhere_exceeded_and_reached_somewhere_in_reach() {
        const N: [usize; 3] = [13, 9, 10];
        let mut draws = Draws::new([4, 1], 0, 0);
        let mut random = || draws.next4().map(uniform);
        let voxels: Vec<f32> = (0..N.iter().product())
            .map(|_| random())
            .map(|[a, b, ..]| if a < 0.9 { 0.1 * b } else { 9.0 * b })
            .collect();
        let grey = |value: f64| Spectrum::new(&[value], "value").expect("valid");
        for linear in [false, true] {
            for (block, extinction) in [(None, 0.01), (Some(1), 3.0), (Some(2), 3.0), (Some(4), 3.0)] {
                let volume = Volume::new(&voxels, N, [1.0, 0.8, 1.1], [0.0; 3], linear).expect("valid");
                let medium = Matter::new(volume, grey(extinction), Albedo::Constant(grey(0.5)), Phase::Isotropic)
                    .expect("valid");
                let light = Light::directional([0.0, 0.0, -1.0], &[1.0]).expect("valid");
                let camera = Camera::perspective([40.0, 0.0, 0.0], [5.0; 3], [0.0, 0.0, 1.0], 30.0, [4, 4]);
                let scene = Scene::new(medium, vec![light], camera.expect("valid"));
                let settings = Settings { tracker: Some(Tracker::Woodcock), ..Settings::default() };
                let mut plan = Plan::new(&scene, &settings).expect("a plan");
                plan.majorant = Some(MajorantGrid::new(&volume, block.unwrap_or(13)));
                let course = Course::new(&plan, Scored::Nowhere, 0);
                assert_eq!(course.majorants().is_some(), block.is_some());
                let sigma = |density: f32| f64::from(density) * extinction;
                let mut most = vec![0.0f64; course.cells.as_ref().map_or(1, |cells| cells.majorant.len())];
                let majorant = |cell: usize| match &course.cells {
                    Some(cells) => f64::from(cells.majorant[cell]),
                    None => 1.0 / f64::from(course.free_path),
                };
                for _ in 0..40_000 {
                    let xi = random();
                    let p: V3 = std::array::from_fn(|a| xi[a] * N[a] as f32);
                    let cell = course.cells.as_ref().map_or(0, |cells| {
                        let c: [usize; 3] =
                            std::array::from_fn(|a| ((p[a] / cells.block) as usize).min(cells.n[a] as usize - 1));
                        (c[2] * cells.n[1] as usize + c[1]) * cells.n[0] as usize + c[0]
                    });
                    let here = sigma(course.field.at(p));
                    assert!(here <= majorant(cell), "{linear} {block:?} {p:?}: {here} above {}", majorant(cell));
                    most[cell] = most[cell].max(here);
                }
                // What is read in voxels reaches their values; between voxels only the coarsest come near it by chance.
                for (cell, most) in most.into_iter().enumerate().filter(|_| !linear) {
                    assert!(majorant(cell) <= most * (1.0 + 1e-5), "{block:?} {cell}: {} for {most}", majorant(cell));
                }
                let voxel = |m: f64| voxels.iter().any(|&v| (sigma(v) - m).abs() <= 1e-5 * m);
                assert!((0..if linear { 1 } else { 0 }).all(|cell| voxel(majorant(cell))));
            }
        }
    }
}
