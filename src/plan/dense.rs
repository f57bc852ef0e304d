//! Voxels thicker than a mean free path: what is scattered in them is seen from its first, and kept as their mean.

use super::probe::seen_depth;
use super::{Angular, Method, Settings, voxel_depth};
use crate::scene::{Light, Scene};

/// From this optical depth of a voxel on, the light scattered in it cannot be taken to change evenly within.
const DENSE: f64 = 1.0;
/// The bias of a half space's picture over the square of its voxels' optical depth, while that is small.
const BIAS: f64 = 0.012;

/// The optical depth of the voxels that are seen, if it biases pictures of what photons leave in them.
pub fn depth(scene: &Scene, settings: &Settings, scatters: bool) -> Option<f64> {
    let sampled =
        scene.medium.emission.is_some() || scene.lights.iter().any(|l| matches!(l, Light::Environment { .. }));
    let kept = settings.max_scatterings.is_none_or(|orders| orders > u32::from(!sampled));
    let photons = !matches!(settings.method, Some(Method::Single | Method::Path));
    // Paths never meet a pencil beam.
    let traced = !scene.lights.iter().any(|light| matches!(light, Light::Pencil { .. }));
    if !(photons && settings.image && scatters && kept && traced) || voxel_depth(scene) < DENSE {
        return None;
    }
    Some(seen_depth(scene)).filter(|&depth| depth >= DENSE)
}

/// Whether pictures alone, of voxels that thick, are made by paths: of what photons leave they would miss the target.
pub fn takes_paths(depth: Option<f64>, settings: &Settings, target: f64) -> bool {
    let images_only = !settings.fluence && !settings.radiance && settings.photons.is_none();
    images_only && settings.angular == Angular::Eye && depth.is_some_and(|depth| BIAS * depth * depth > target)
}
