//! What the plan decides for each light: where its photons start, and how its unscattered light is found.

use super::probe::{fine_error, interpolation_error};
use super::settings::Settings;
use crate::physics::lattice::Lattice;
use crate::scene::{Light, Scene, Volume};

/// Where the photons of a light start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Emission {
    /// None are shot: order 0 and 1 are all that is wanted of this light.
    Nothing,
    /// At the light; orders 0 and up are walked.
    AtLight,
    /// At the first collision, drawn from the light grid.
    FirstCollision,
}

/// How the unscattered light of a light is found in voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direct {
    /// By light rays through the whole box, each exact along its way: so many for each cell of a plane, [`REPLICATES`] times.
    Rays(Rays),
    /// Exactly, along a pencil beam.
    Beam,
    /// By photons.
    Sampled,
}

/// How the optical depth towards a light is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Column {
    /// Interpolated in the light grid.
    Grid,
    /// By a light ray from every point.
    Rays,
}

/// What happens with one light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightPlan {
    /// Where its photons start.
    pub emission: Emission,
    /// How its order 0 is found.
    pub direct: Direct,
    /// How the optical depth towards it is found.
    pub column: Column,
    /// Relative error of an order 1 image if that were interpolated.
    pub interpolation_error: f64,
    /// The same with two nodes per voxel, for light rays in pictures.
    pub fine_error: f64,
    /// Whether first collisions are weighed with the interpolated depth.
    pub interpolated_starts: bool,
}

impl LightPlan {
    /// Whether pictures may interpolate the optical depth between two nodes per voxel, where light rays to all of these are
    /// fewer than to each sample.
    pub fn fine(&self) -> bool {
        self.column == Column::Rays && 0.0 < self.fine_error && self.fine_error <= INTERPOLATION_ERROR
    }
}

/// Light rays for the unscattered light in voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rays {
    /// Those of each patch of a plane.
    pub lattice: Lattice,
    /// Whether patches are larger than cells, and rays find only by how much less light there is than in a vacuum.
    pub sparse: bool,
}

/// Lattices of random shift that light rays are dealt out in; the scatter among these is the standard error of what they find.
pub const REPLICATES: u64 = 8;
/// Voxels that the light rays of small volumes cross, all together: at least, at most, and for each photon.
const CROSSED: [f64; 2] = [1e5, 2e6];
const CROSSED_PER_PHOTON: f64 = 100.0;
/// Up to this optical depth of a voxel few rays tell how much less light there is in it than in a vacuum.
const SPARSE_DEPTH: f64 = 0.3;
/// Above this relative error of an order 1 image the optical depth towards a light is not interpolated in the light grid.
const INTERPOLATION_ERROR: f64 = 0.005;
/// Up to this error photons may still start at collisions drawn with interpolated depths: what is scattered again has
/// forgotten most of it.
const START_ERROR: f64 = 0.01;
/// Above this optical depth per voxel photons start at the light, for first collisions fill a voxel unevenly.
const FIRST_COLLISION_DEPTH: f64 = 1.0;

/// What happens with a light: `depth` is the largest optical depth of a voxel, `shoots` whether orders >= 1 are walked.
pub(super) fn plan_light(scene: &Scene, settings: &Settings, light: &Light, depth: f64, shoots: bool) -> LightPlan {
    let sees = settings.image;
    let volume = &scene.medium.volume;
    let at_light = if shoots { Emission::AtLight } else { Emission::Nothing };
    match light {
        Light::Environment { .. } => LightPlan {
            emission: Emission::AtLight,
            direct: Direct::Sampled,
            column: Column::Grid,
            interpolation_error: 0.0,
            fine_error: 0.0,
            interpolated_starts: false,
        },
        Light::Pencil { .. } => LightPlan {
            emission: at_light,
            direct: Direct::Beam,
            column: Column::Rays,
            interpolation_error: 0.0,
            fine_error: 0.0,
            interpolated_starts: false,
        },
        Light::Point { .. } | Light::Directional { .. } => {
            let near = match light {
                Light::Point { position, .. } => {
                    let (p, size, h) = (volume.local(*position), volume.size(), volume.spacing());
                    (0..3).all(|a| p[a] > -2.0 * h[a] && p[a] < size[a] + 2.0 * h[a])
                }
                _ => false,
            };
            let first = shoots && !near && depth <= FIRST_COLLISION_DEPTH;
            let emission = if first { Emission::FirstCollision } else { at_light };
            // Rays through constant density have a closed form: no grid is as cheap.
            let constant = volume.is_constant();
            let interpolates = !constant && (sees || first);
            let interpolation_error = if interpolates { interpolation_error(scene, light) } else { 0.0 };
            let rays = constant || !sees || interpolation_error > INTERPOLATION_ERROR;
            let fine_error = if rays && interpolates && sees { fine_error(scene, light) } else { 0.0 };
            let column = if rays { Column::Rays } else { Column::Grid };
            let work = crossed(volume, light) * work_in_voxels(scene);
            // Few photons are noisier than any rays.
            let photons = settings.photons.filter(|_| shoots).map_or(f64::INFINITY, |photons| photons as f64);
            let lattice = Lattice::up_to(
                CROSSED[1].min(CROSSED[0].max(CROSSED_PER_PHOTON * photons)) / (REPLICATES as f64 * work),
            );
            let sparse = lattice.points() == 1 && matches!(light, Light::Point { .. }) && depth <= SPARSE_DEPTH;
            let direct = Direct::Rays(Rays { lattice, sparse });
            let interpolated_starts = !constant && interpolation_error <= START_ERROR;
            LightPlan { emission, direct, column, interpolation_error, fine_error, interpolated_starts }
        }
    }
}

/// How many times more work a ray has in thick voxels than in thin ones, on average: where the density is linear, pieces of a
/// small optical depth, until it is dark.
pub fn work_in_voxels(scene: &Scene) -> f64 {
    const DARK: f64 = 40.0;
    // Pieces of a fifth, of which a thin voxel has two.
    const VOXEL: f64 = 2.0 * 0.2;
    let volume = &scene.medium.volume;
    // A constant density has no pieces, but one voxel that differs by little must not change the rays.
    if !volume.linear() {
        return 1.0;
    }
    let across = 0.5 * volume.n().iter().sum::<usize>() as f64;
    let depth = scene.medium.extinction.max() * volume.mean() * volume.spacing().iter().sum::<f64>() / 3.0;
    1.0 + (across * depth).min(DARK) / (VOXEL * across)
}

/// About how many voxels the rays of a light cross that are one for each cell.
pub fn crossed(volume: &Volume, light: &Light) -> f64 {
    let (n, h) = (volume.n().map(|m| m as f64), volume.spacing());
    match light {
        Light::Directional { direction, .. } => {
            let speed: [f64; 3] = std::array::from_fn(|a| direction[a].abs() / h[a]);
            n.iter().product::<f64>() * speed.iter().sum::<f64>() / speed.into_iter().fold(0.0, f64::max)
        }
        Light::Point { position, .. } => {
            let (p, size) = (volume.local(*position), volume.size());
            let faces = |a: usize| f64::from(u8::from(p[a] > 0.0) + u8::from(p[a] < size[a]));
            let cells: f64 = (0..3).map(|a| faces(a) * n[(a + 1) % 3] * n[(a + 2) % 3]).sum();
            cells * n.iter().sum::<f64>() * 0.5
        }
        Light::Pencil { .. } | Light::Environment { .. } => 0.0,
    }
}
