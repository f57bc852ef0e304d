//! What the plan decides for each light: where its photons start, and how its unscattered light is found.

use super::probe::{fine_error, interpolation_error};
use crate::scene::{Light, Scene};

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
    /// By Gauss points in each voxel.
    Quadrature {
        /// Points per axis.
        points: usize,
        /// A light ray from each point, rather than the light grid put right by one ray from the centre.
        rays: bool,
    },
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

/// Above this relative error of an order 1 image the optical depth towards a light is not interpolated in the light grid.
const INTERPOLATION_ERROR: f64 = 0.005;
/// Up to this error photons may still start at collisions drawn with interpolated depths: what is scattered again has
/// forgotten most of it.
const START_ERROR: f64 = 0.01;
/// Above this optical depth per voxel photons start at the light, for first collisions fill a voxel unevenly.
const FIRST_COLLISION_DEPTH: f64 = 1.0;

/// What happens with a light: `depth` is the largest optical depth of a voxel, `shoots` whether orders >= 1 are walked,
/// `voxels` whether values of voxels are wanted.
pub(super) fn plan_light(scene: &Scene, light: &Light, depth: f64, shoots: bool, voxels: bool) -> LightPlan {
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
            let interpolation_error = if constant { 0.0 } else { interpolation_error(scene, light) };
            let rays = constant || interpolation_error > INTERPOLATION_ERROR;
            let fine_error = if rays && !constant { fine_error(scene, light) } else { 0.0 };
            let column = if rays { Column::Rays } else { Column::Grid };
            let direct = choose_quadrature(depth, volume.voxels(), constant, voxels);
            let interpolated_starts = !constant && interpolation_error <= START_ERROR;
            LightPlan { emission, direct, column, interpolation_error, fine_error, interpolated_starts }
        }
    }
}

/// Gauss points per axis that a voxel of an optical depth needs.
pub fn points_for(depth: f64) -> usize {
    match depth {
        d if d <= 0.15 => 1,
        d if d <= 1.5 => 2,
        d if d <= 3.0 => 3,
        d if d <= 6.0 => 4,
        d if d <= 12.0 => 8,
        _ => 16,
    }
}

/// As many points per voxel as its depth needs, and more where they cost nothing to speak of: kinks of the depth behind
/// the box's edges are then averaged. A light ray for each where that is affordable.
fn choose_quadrature(depth: f64, voxels: usize, constant: bool, kept: bool) -> Direct {
    let needed = points_for(depth);
    if !kept {
        // The energy balance needs sums only.
        return Direct::Quadrature { points: needed.min(4), rays: constant };
    }
    // In constant density a ray has a closed form.
    let affordable = if constant { 2e7 } else { 4e6 };
    let spare = ((affordable / voxels as f64).cbrt() as usize).clamp(1, 4);
    let points = spare.max(needed);
    let cost = (points as f64).powi(3) * voxels as f64;
    let rays = constant || cost <= affordable;
    Direct::Quadrature { points, rays }
}
