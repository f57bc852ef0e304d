//! The lights of a scene as seen from within it: their light grids, and their views.

use super::Control;
use super::cpu::light::Illumination;
use crate::plan::{Column, LightPlan, Plan, cost};
use crate::scene::field::Occupancy;
use crate::scene::{Light, Scene};

/// The light grids of the lights that need them; the sweep that finds them is linear in the voxels, and the same for all
/// devices.
pub fn light_grids(plan: &Plan, occupancy: Option<&Occupancy>, control: &Control) -> Vec<Option<Vec<f32>>> {
    let scene = plan.scene;
    let grid = |(light, how): (&Light, &LightPlan)| {
        if !cost::uses_grid(how, light, scene.medium.volume.is_constant()) {
            return None;
        }
        Illumination::new(scene, occupancy, light, how.column, None).map(|view| view.columns(control))
    };
    scene.lights.iter().zip(&plan.lights).map(grid).collect()
}

/// The views of all lights, `None` for those without a direction.
pub fn illuminations<'a>(
    scene: &'a Scene<'a>,
    occupancy: Option<&'a Occupancy>,
    how: impl Iterator<Item = Column>,
    columns: &'a [Option<Vec<f32>>],
) -> Vec<Option<Illumination<'a>>> {
    scene
        .lights
        .iter()
        .zip(how)
        .zip(columns)
        .map(|((light, column), nodes)| Illumination::new(scene, occupancy, light, column, nodes.as_deref()))
        .collect()
}
