//! Which tally layers there are, and which incident orders are scored in each.

use super::{Direct, Emission, LightPlan, Settings};
use crate::scene::Scene;

/// A tally layer of the photon walk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layer {
    /// Fluence of incident order 0.
    Unscattered,
    /// Fluence of incident orders that images see (1 to n - 1).
    Inner,
    /// Fluence of the last order n, which no image sees.
    Last,
    /// P-weighted towards the eye, incident order 0.
    EyeUnscattered,
    /// P-weighted towards the eye, incident orders 1 to n - 1.
    Eye,
    /// Spherical harmonics of incident order 0.
    HarmonicsUnscattered,
    /// Spherical harmonics of incident orders 1 to n - 1.
    Harmonics,
    /// Fluence of all incident orders times absorption, relative to that of the densest voxel.
    Absorbed,
}

/// The layers that an incident order is scored in: (plain, by direction), as indices into [`Plan::layers`].
pub type Route = (Option<usize>, Option<usize>);

/// The layers, and the routes of incident orders 0, 1..n-1 and n.
pub(super) fn choose(
    scene: &Scene,
    settings: &Settings,
    (lights, emits): (&[LightPlan], bool),
    scattered: bool,
    orders: u32,
    harmonics: bool,
) -> (Vec<Layer>, [Route; 3]) {
    let isotropic = scene.medium.phase.is_isotropic();
    let wants_source = orders > 0 && (settings.radiance || settings.image);
    let sampled = emits || lights.iter().any(|l| l.direct == Direct::Sampled && l.emission == Emission::AtLight);
    let scattered = scattered && (emits || lights.iter().any(|l| l.emission != Emission::Nothing));
    let mut layers = Vec::new();
    let mut add = |wanted: bool, layer: Layer| {
        wanted.then(|| {
            layers.push(layer);
            layers.len() - 1
        })
    };
    let any = settings.fluence || wants_source;
    if isotropic {
        let unscattered = add(sampled && any, Layer::Unscattered);
        let inner = add(scattered && any && (orders > 1 || orders == u32::MAX), Layer::Inner);
        let last = add(scattered && settings.fluence && orders != u32::MAX, Layer::Last);
        (layers, [(unscattered, None), (inner, None), (last, None)])
    } else {
        let fluence = add((sampled || scattered) && settings.fluence, Layer::Inner);
        let (zero, more) = match harmonics {
            true => (Layer::HarmonicsUnscattered, Layer::Harmonics),
            false => (Layer::EyeUnscattered, Layer::Eye),
        };
        let eye0 = add(sampled && wants_source, zero);
        let eye = add(scattered && wants_source && orders > 1, more);
        (layers, [(fluence, eye0), (fluence, eye), (fluence, None)])
    }
}
