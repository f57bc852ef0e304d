//! Unscattered light in the voxels, whatever on: what all lights whose order 0 no photons find leave there.

use super::Control;
use super::cpu::unscattered::{Aim, Means, Wanted, coalbedo, cosine, means, over_beam};
use crate::error::{Error, Result};
use crate::plan::{Direct, Plan, REPLICATES, Rays};
use crate::scene::Light;
use crate::scene::eye::LocalEye;
use crate::tally::Moments;
use rayon::prelude::*;

/// 1 / (4 pi).
const PER_SPHERE: f64 = 0.25 * std::f64::consts::FRAC_1_PI;

/// What unscattered light leaves in the voxels, and its standard error.
#[derive(Debug, Default)]
pub struct Single {
    /// Fluence, where it is wanted.
    pub fluence: Vec<f32>,
    /// Its standard error.
    pub fluence_error: Vec<f32>,
    /// Absorbed power density, where that is found by itself.
    pub absorbed: Vec<f32>,
    /// Its standard error.
    pub absorbed_error: Vec<f32>,
    /// J towards the eye, where the radiance of voxels is wanted.
    pub source: Vec<f32>,
    /// Its standard error.
    pub source_error: Vec<f32>,
}

/// What the lights of a plan leave whose unscattered light is not sampled by photons.
pub fn single(plan: &Plan, control: &Control) -> Result<Single> {
    let values = plan.scene.medium.volume.voxels() * plan.channels;
    let zeros = |wanted: bool| vec![0.0; if wanted { values } else { 0 }];
    let (fluence, absorbed, source) = (plan.settings.fluence, plan.finds_absorbed(), plan.settings.radiance);
    let mut sum = Single {
        fluence: zeros(fluence),
        fluence_error: zeros(fluence),
        absorbed: zeros(absorbed),
        absorbed_error: zeros(absorbed),
        source: zeros(source),
        source_error: zeros(source),
    };
    if !(fluence || source && plan.wants_source()) {
        return Ok(sum);
    }
    for (at, (light, how)) in plan.scene.lights.iter().zip(&plan.lights).enumerate() {
        match (how.direct, light) {
            (Direct::Rays(how), _) => {
                let Some(aim) = Aim::new(&plan.scene.medium.volume, light) else { continue };
                sum.add(plan, light, &rays(plan, (at, &aim), how, control)?);
            }
            (Direct::Beam, Light::Pencil { position, direction, power }) => {
                sum.add_beam(plan, *position, *direction, power.rgb);
            }
            _ => {}
        }
    }
    if control.stopped() { Err(Error::Interrupted) } else { Ok(sum) }
}

/// The means of a light that rays find.
fn rays(plan: &Plan, light: (usize, &Aim), how: Rays, control: &Control) -> Result<Means> {
    let (scene, seed) = (plan.scene, plan.settings.seed);
    let phase = &scene.medium.phase;
    let sends = plan.settings.radiance && plan.wants_source();
    // Parallel light comes to a voxel from one direction, and all directions are one to an isotropic phase function.
    let by_direction = sends && light.1.is_point() && !phase.is_isotropic();
    let wanted = Wanted {
        fluence: plan.settings.fluence || sends && !by_direction,
        absorbed: plan.finds_absorbed(),
        seen: by_direction.then(|| (phase, LocalEye::new(scene, &scene.camera))),
    };
    if scene.medium.is_chromatic() {
        means::<3>(scene, light, how, seed, wanted, control)
    } else {
        means::<1>(scene, light, how, seed, wanted, control)
    }
}

/// Adds independent values in some units to a mean, and their spread to its standard error.
fn accumulate(
    (mean, error): (&mut [f32], &mut [f32]),
    moments: &Moments,
    channels: usize,
    unit: impl Fn(usize) -> [f64; 3] + Sync,
) {
    let voxels = mean.len() / channels.max(1);
    let extinctions = moments.mean.len().checked_div(voxels).unwrap_or(1);
    mean.par_chunks_mut(channels).zip(error.par_chunks_mut(channels)).enumerate().for_each(|(voxel, (mean, error))| {
        let unit = unit(voxel);
        for c in 0..channels {
            let at = voxel * extinctions + c % extinctions;
            mean[c] += (moments.mean[at] * unit[c]) as f32;
            let spread = f64::from(Moments::error(moments.m2[at], REPLICATES)) * unit[c];
            error[c] = error[c].hypot(spread as f32);
        }
    });
}

impl Single {
    /// Adds a light that rays found.
    fn add(&mut self, plan: &Plan, light: &Light, found: &Means) {
        let (scene, channels) = (plan.scene, plan.channels);
        let volume = &scene.medium.volume;
        let (n, h, value) = (volume.n(), volume.spacing().map(|c| c as f32), light.value().rgb);
        let cell = |voxel: usize| [voxel % n[0], voxel / n[0] % n[1], voxel / (n[0] * n[1])];
        if let (Some(fluence), true) = (&found.fluence, plan.settings.fluence) {
            let unit = |voxel: usize| value.map(|value| value * found.units(cell(voxel))[0]);
            accumulate((&mut self.fluence, &mut self.fluence_error), fluence, channels, unit);
        }
        if let Some(absorbed) = &found.absorbed {
            let coalbedo = coalbedo(scene);
            let unit = |voxel: usize| {
                let unit = found.units(cell(voxel))[1];
                std::array::from_fn(|c| value[c] * coalbedo[c] * unit)
            };
            accumulate((&mut self.absorbed, &mut self.absorbed_error), absorbed, channels, unit);
        }
        if !(plan.settings.radiance && plan.wants_source()) {
            return;
        }
        let source = (self.source.as_mut_slice(), self.source_error.as_mut_slice());
        let (phase, eye) = (&scene.medium.phase, LocalEye::new(scene, &scene.camera));
        match (&found.seen, &found.fluence, light) {
            (Some(seen), ..) => {
                accumulate(source, seen, channels, |voxel| value.map(|value| value * found.units(cell(voxel))[2]));
            }
            (_, Some(fluence), Light::Directional { direction, .. }) if !phase.is_isotropic() => {
                let along = direction.map(|c| c as f32);
                accumulate(source, fluence, channels, |voxel| {
                    let toward = eye.from(cell(voxel).map(|c| c as f32 + 0.5), h);
                    let p = f64::from(phase.pdf(cosine(toward, along)));
                    value.map(|value| value * p * found.units(cell(voxel))[0])
                });
            }
            (_, Some(fluence), _) => accumulate(source, fluence, channels, |voxel| {
                value.map(|value| value * PER_SPHERE * found.units(cell(voxel))[0])
            }),
            _ => {}
        }
    }

    /// Adds a pencil beam, which is exact.
    fn add_beam(&mut self, plan: &Plan, position: [f64; 3], direction: [f64; 3], power: [f64; 3]) {
        let scene = plan.scene;
        let volume = &scene.medium.volume;
        let (n, h, channels) = (volume.n(), volume.spacing().map(|c| c as f32), plan.channels);
        let eye = LocalEye::new(scene, &scene.camera);
        let along = direction.map(|c| c as f32);
        over_beam(scene, position, direction, |cell, path, absorbed| {
            let toward = eye.from(cell.map(|c| c as f32 + 0.5), h);
            let p = if plan.wants_source() { f64::from(scene.medium.phase.pdf(cosine(toward, along))) } else { 0.0 };
            let voxel = (cell[2] * n[1] + cell[1]) * n[0] + cell[0];
            for c in 0..channels {
                let (at, power) = (voxel * channels + c, power[c] / volume.voxel_volume());
                for (list, value) in
                    [(&mut self.fluence, path[c]), (&mut self.absorbed, absorbed[c]), (&mut self.source, path[c] * p)]
                {
                    if let Some(sum) = list.get_mut(at) {
                        *sum += (power * value) as f32;
                    }
                }
            }
        });
    }
}
