//! How paths from the camera run: how many, from where, and how their vertices are connected to each light.

use super::probe::{self, interpolation_error};
use super::{Column, Direct, Emission, Explain, LightPlan, Rays, Settings};
use crate::error::{Result, scene_error};
use crate::physics::lattice::Lattice;
use crate::scene::{Light, Scene};

/// Paths from the camera.
#[derive(Debug, Clone, PartialEq)]
pub struct PathPlan {
    /// Paths per view ray.
    pub starts: u64,
    /// Whether they begin at collisions drawn from a walk along the ray, or fly on from where it enters the box.
    pub walked: bool,
    /// View rays per pixel, if their number is given.
    pub rays: Option<u64>,
    /// View rays per pixel that are taken between two looks at the clock.
    pub pass: u64,
    /// How vertices are connected to each light.
    pub connections: Vec<Connection>,
}

/// How a vertex finds the light that reaches it from a source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Connection {
    /// The depth interpolated in the light grid, and put right by a light ray with this chance.
    Corrected(f32),
    /// A light ray.
    Ray,
    /// The light stands in the medium or next to it: points on the way to the next vertex are drawn by their distance
    /// from it, in place of the vertices themselves.
    Near,
    /// Radiance from everywhere: what leaves the volume meets it.
    Environment,
}

/// First collisions on a view ray: what the ray costs is then shared, and they are spread evenly over what it meets.
const STARTS: u64 = 4;
/// View rays per pixel at least, for a variance.
const LEAST_RAYS: u64 = 2;
/// Paths between two looks at the clock.
const PASS: u64 = 1 << 19;
/// Beyond this mean opacity hardly a path misses that sets out without knowing what its ray meets, and it is cheaper to let
/// it fly than to walk along the ray first.
const OPAQUE: f64 = 0.6;
/// A light nearer to the box than this part of its shortest side is close to the medium.
const NEAR: f64 = 0.25;
/// The chance of a correcting ray lies between these.
const CHECKS: (f64, f64) = (1.0 / 32.0, 0.5);
/// Samples per pixel that a run without their number is taken to need.
const TYPICAL: u64 = 256;

/// What paths need of the settings.
pub(super) fn plan(scene: &Scene, settings: &Settings, connections: Vec<Connection>, why: &mut Explain) -> PathPlan {
    let pixels = (scene.camera.resolution[0] * scene.camera.resolution[1]) as u64;
    let starts = settings.spp.map_or(STARTS, |spp| (spp / LEAST_RAYS).clamp(1, STARTS));
    let rays = settings.spp.map(|spp| spp.div_ceil(starts).max(1));
    let pass = (PASS / (pixels * starts)).clamp(1, 64).min(rays.unwrap_or(u64::MAX));
    why.push(
        "paths",
        match rays {
            Some(rays) => format!("{rays} view rays a pixel, {starts} paths on each"),
            None => format!("passes of {pass} view rays a pixel, {starts} paths on each"),
        },
        match (settings.spp, settings.time_limit) {
            (Some(spp), _) => format!("spp = {spp} asked for"),
            (None, Some(limit)) => format!("until {limit} s have passed or the error is reached"),
            (None, None) => "until the error is reached".into(),
        },
    );
    let opacity = probe::opacity(scene);
    let near = connections.contains(&Connection::Near);
    let walked = near || opacity < OPAQUE;
    why.push(
        "first collisions",
        if walked { "drawn from a walk along each view ray" } else { "flown to" }.into(),
        if near && opacity >= OPAQUE {
            "a light stands in the medium or next to it".into()
        } else {
            format!("view rays that meet anything see an opacity of {opacity:.2}")
        },
    );
    PathPlan { starts, walked, rays, pass, connections }
}

/// How a light is connected to.
pub(super) fn plan_light(scene: &Scene, settings: &Settings, light: &Light) -> Result<(LightPlan, Connection)> {
    let volume = &scene.medium.volume;
    let none = |column, interpolation_error| LightPlan {
        emission: Emission::Nothing,
        direct: Direct::Rays(Rays { lattice: Lattice::of(1.0), sparse: false }),
        column,
        interpolation_error,
        fine_error: 0.0,
        interpolated_starts: false,
    };
    match light {
        Light::Pencil { .. } => scene_error(
            "method = \"path\" cannot see a PencilBeam: paths from the camera never meet an infinitely thin beam; use \
             method = \"photon\"",
        ),
        Light::Environment { .. } => Ok((none(Column::Rays, 0.0), Connection::Environment)),
        Light::Point { .. } | Light::Directional { .. } => {
            if let Light::Point { position, .. } = light {
                let (p, size) = (volume.local(*position), volume.size());
                let off = (0..3).map(|a| (-p[a]).max(p[a] - size[a]).max(0.0).powi(2)).sum::<f64>().sqrt();
                if off < NEAR * size.into_iter().fold(f64::INFINITY, f64::min) {
                    return Ok((none(Column::Rays, 0.0), Connection::Near));
                }
            }
            if volume.is_constant() || !grid_pays(scene, settings) {
                return Ok((none(Column::Rays, 0.0), Connection::Ray));
            }
            let error = interpolation_error(scene, light);
            // The variance of a correction is error^2 / chance, that of a path near 1; a ray costs a few connections.
            let chance = (0.8 * error).max(CHECKS.0);
            if chance > CHECKS.1 {
                return Ok((none(Column::Rays, error), Connection::Ray));
            }
            Ok((none(Column::Grid, error), Connection::Corrected(chance as f32)))
        }
    }
}

/// Whether the light rays of all connections would take longer than a light grid.
fn grid_pays(scene: &Scene, settings: &Settings) -> bool {
    let n = scene.medium.volume.n().map(|m| m as f64);
    let pixels = (scene.camera.resolution[0] * scene.camera.resolution[1]) as f64;
    let orders = f64::from(settings.max_scatterings.unwrap_or(u32::MAX).min(8));
    let connections = pixels * settings.spp.unwrap_or(TYPICAL) as f64 * orders;
    connections * (n[0] + n[1] + n[2]) * 3e-9 > n[0] * n[1] * n[2] * 45e-9
}
