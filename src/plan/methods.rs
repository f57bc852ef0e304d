//! Which method runs: the cheapest that is good enough, or the one that was asked for.

use super::explain::Explain;
use super::{Method, Settings, Tracker, dense};
use crate::error::{Result, scene_error};
use crate::scene::Scene;

/// The relative error of a run without a budget.
pub(super) const TARGET: f64 = 0.02;

/// The method; `scatters` says whether the medium does, `dense` how thick the voxels are that are seen, if they are.
pub(super) fn choose(
    scene: &Scene,
    settings: &Settings,
    target_error: Option<f64>,
    (scatters, dense): (bool, Option<f64>),
    why: &mut Explain,
) -> Result<Method> {
    let medium = &scene.medium;
    if medium.volume.is_ball() {
        if let Some(method @ (Method::Single | Method::Photon)) = settings.method {
            return scene_error(format!(
                "method = \"{method}\" needs voxels, and a sphere has none; use method = \"path\""
            ));
        }
        if settings.tracker == Some(Tracker::March) {
            return scene_error("tracker = \"march\" needs voxels, and a sphere has none; use \"analytic\"");
        }
        why.push("method", Method::Path.to_string(), "a sphere has no voxels".into());
        return Ok(Method::Path);
    }
    // A bound on what leaves order 1 for order 2, and so on: albedo times the chance of a collision on the longest way.
    let diagonal = medium.volume.size().iter().map(|s| s * s).sum::<f64>().sqrt();
    let again = medium.max_albedo() * -(-medium.max_sigma_t() * diagonal).exp_m1();
    let beyond = if again < 1.0 { again / (1.0 - again) } else { f64::INFINITY };
    let (method, reason) = match (settings.method, target_error) {
        (Some(Method::Single), _) => {
            (Method::Single, format!("asked for; orders >= 2, which may reach {beyond:.2} of order 1, are left out"))
        }
        (Some(method), _) => (method, "asked for".into()),
        (None, _) if settings.spp.is_some() => (Method::Path, "spp is given".into()),
        (None, Some(target)) if scatters && settings.max_scatterings != Some(0) && beyond < 0.5 * target => {
            (Method::Single, format!("orders >= 2 are below {beyond:.1e} of order 1, the target is {target}"))
        }
        (None, target) if dense::takes_paths(dense, settings, target.unwrap_or(TARGET)) => {
            (Method::Path, format!("voxels that are seen are {:.2} mean free paths thick", dense.unwrap_or(0.0)))
        }
        (None, _) => (Method::Photon, format!("orders >= 2 may reach {beyond:.2} of order 1")),
    };
    why.push("method", method.to_string(), reason);
    Ok(method)
}
