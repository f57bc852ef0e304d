//! How free flights are sampled: by which tracker, and whether in lanes.

use super::explain::Explain;
use super::{LEAST_SCORED_DEPTH, MajorantGrid, Method, Settings, Simd, StepCosts, Tracker};
use crate::error::{Result, scene_error};
use crate::scene::Scene;

/// Why photons or paths must be walked one by one, whatever the tracker; `None` where lanes may walk them.
pub(super) fn refuses_lanes(
    scene: &Scene,
    settings: &Settings,
    method: Method,
    chromatic: bool,
) -> Option<&'static str> {
    match settings.simd {
        Some(Simd::Scalar) => Some("MCRT_SIMD = scalar"),
        _ if chromatic => Some("extinction differs between channels"),
        _ if method == Method::Path && scene.medium.emission.is_some() => Some("flights gather what the medium emits"),
        // Lanes count voxels in 32 bits.
        _ if u32::try_from(scene.medium.volume.voxels()).is_err() => Some("there are more than 2^32 voxels"),
        _ => None,
    }
}

pub(super) fn choose_tracker(
    scene: &Scene,
    settings: &Settings,
    chromatic: bool,
    lanes: bool,
    why: &mut Explain,
) -> Result<(Tracker, Option<MajorantGrid>)> {
    let medium = &scene.medium;
    let volume = &medium.volume;
    let h = volume.spacing();
    let mean_h = 3.0 / h.iter().map(|h| 1.0 / h).sum::<f64>();
    let depth = medium.extinction.max() * mean_h;
    let costs = if lanes {
        let least = if settings.fluence || settings.radiance { LEAST_SCORED_DEPTH } else { 0.0 };
        StepCosts { least, ..StepCosts::LANES }
    } else {
        StepCosts::SCALAR
    };
    let build = |tracker| match tracker {
        Tracker::Woodcock if volume.is_constant() => {
            let longest = volume.n().into_iter().max().unwrap_or(1);
            Some(MajorantGrid::new(volume, longest))
        }
        Tracker::Woodcock => Some(MajorantGrid::cheapest(volume, depth, costs).0),
        _ => None,
    };
    if let Some(tracker) = settings.tracker {
        if tracker == Tracker::Analytic && chromatic {
            return scene_error("tracker = \"analytic\" needs equal extinction in all channels; use \"woodcock\"");
        }
        why.push("tracker", format!("{tracker:?}").to_lowercase(), "asked for".into());
        return Ok((tracker, build(tracker)));
    }
    if volume.is_constant() && !chromatic {
        why.push("tracker", "analytic".into(), "the density is constant: free flights in closed form, no grid".into());
        return Ok((Tracker::Analytic, None));
    }
    if volume.is_constant() {
        why.push("tracker", "woodcock".into(), "the density is constant: one cell, the majorant is the medium".into());
        return Ok((Tracker::Woodcock, build(Tracker::Woodcock)));
    }
    let (grid, cost) = MajorantGrid::cheapest(volume, depth, costs);
    // The walk crosses 1.5 voxels per voxel of length; interpolation halves the cells that it steps over.
    let march = if volume.linear() { 12.0 } else { 2.0 };
    if cost <= march {
        why.push(
            "tracker",
            "woodcock".into(),
            format!(
                "expected cost per voxel of flight {cost:.2}, marching {march:.1}; {}",
                if grid.is_one() { "one majorant".into() } else { format!("cells of {}^3 voxels", grid.block) }
            ),
        );
        Ok((Tracker::Woodcock, Some(grid)))
    } else {
        why.push(
            "tracker",
            "march".into(),
            format!("expected cost per voxel of flight {march:.1}; null collisions would cost {cost:.2}"),
        );
        Ok((Tracker::March, None))
    }
}
