//! How the radiance that scatters in an anisotropic medium is recorded: towards one eye, or in spherical harmonics for all.

use super::{Angular, Explain, Settings};
use crate::physics::Phase;
use crate::physics::harmonics::{MAX_ORDER, count};
use crate::scene::Scene;

/// The order of the spherical harmonics, if they are used, and a warning where the highest does not reach the target.
pub(super) fn choose(
    scene: &Scene,
    settings: &Settings,
    target_error: Option<f64>,
    why: &mut Explain,
) -> (Option<usize>, Option<String>) {
    let phase = &scene.medium.phase;
    let sees = settings.image || settings.radiance;
    let Angular::Harmonics(asked) = settings.angular else {
        if !phase.is_isotropic() && sees {
            why.push("angular", "towards the eye".into(), "angular=\"sh\" would serve cameras with other eyes".into());
        }
        return (None, None);
    };
    if phase.is_isotropic() || !sees {
        why.push("angular", "fluence".into(), "the phase function is isotropic: every camera is served".into());
        return (None, None);
    }
    let goal = 0.5 * target_error.unwrap_or(0.02);
    let picked = match phase {
        Phase::Rayleigh => 2,
        _ => (0..MAX_ORDER).find(|&order| truncation(phase, order) <= goal).unwrap_or(MAX_ORDER),
    };
    let order = asked.unwrap_or(picked);
    let left_out = truncation(phase, order);
    why.push(
        "angular",
        format!("spherical harmonics of order {order}, {} values a voxel", count(order)),
        format!("leave out about {:.2} % of orders >= 2", 100.0 * left_out),
    );
    let warning = (left_out > goal).then(|| {
        format!(
            "angular: spherical harmonics of order {order} leave out about {:.1} % of orders >= 2 (the goal is {:.1} %); \
             without angular=\"sh\" the run is recorded towards its own eye, and leaves out nothing",
            100.0 * left_out,
            100.0 * goal
        )
    });
    (Some(order), warning)
}

/// What harmonics beyond `order` would add to an image, root mean square over directions, relative to its mean: light that
/// was scattered once has the coefficients p_l, and is scattered into the eye by p_l again, so that the part of degree l
/// is (2l + 1) p_l^4. A ceiling for what was scattered more often.
fn truncation(phase: &Phase, order: usize) -> f64 {
    let tail = |l: usize| (2 * l + 1) as f64 * phase.legendre(l).powi(4);
    (order + 1..=64).map(tail).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rayleigh_ends_at_two_and_henyey_greenstein_falls_geometrically() {
        assert!(truncation(&Phase::Rayleigh, 1) > 0.02 && truncation(&Phase::Rayleigh, 2) < 1e-6);
        let hg = Phase::henyey_greenstein(0.6).expect("valid");
        let (a, b) = (truncation(&hg, 3), truncation(&hg, 4));
        assert!(b < 0.5 * a && b > 0.2 * a);
    }
}
