//! Unscattered light in the voxels by quadrature, whatever on: means over each voxel, and what they add up to.

use super::cpu::light::{Illumination, Quadrature, voxel_fluence};
use super::cpu::shoot::LocalEye;
#[cfg(feature = "gpu")]
use super::gpu;
use super::shot::pad;
use super::{Control, Device};
use crate::error::{Error, Result};
use crate::plan::{Direct, Emission, Plan};
use crate::scene::field::V3;
use crate::scene::{Albedo, Scene};
use rayon::prelude::*;
use std::ops::Range;

/// What unscattered light leaves in the voxels.
#[derive(Debug)]
pub struct Single {
    /// Fluence, where it is wanted.
    pub fluence: Vec<f32>,
    /// J towards the eye, where the radiance of voxels is wanted.
    pub source: Vec<f32>,
    /// Power that collides of lights that shoot no photons, by light and channel: (absorbed, scattered).
    pub collided: Vec<[[f64; 3]; 2]>,
}

/// A light whose unscattered light is found by quadrature.
#[derive(Debug, Clone, Copy)]
pub struct Lit<'v, 'a> {
    /// Its number.
    pub light: usize,
    /// The light as seen from within the volume.
    pub view: &'v Illumination<'a>,
    /// Gauss points per axis of a voxel, those of the densest.
    pub points: usize,
    /// Whether each has a light ray.
    pub rays: bool,
}

/// The unscattered light of all lights that are found by quadrature.
pub fn single(plan: &Plan, views: &[Option<Illumination>], device: &Device, control: &Control) -> Result<Single> {
    match single_on(plan, views, device, control) {
        // With a device nothing is lost that the CPU could not find too.
        Err(Error::DeviceLost(_)) => single_on(plan, views, &Device::Cpu, control),
        found => found,
    }
}

/// The same on a device that does not get lost.
fn single_on(plan: &Plan, views: &[Option<Illumination>], device: &Device, control: &Control) -> Result<Single> {
    let values = plan.scene.medium.volume.voxels() * plan.channels;
    let mut sum = Single {
        fluence: vec![0.0; if plan.settings.fluence { values } else { 0 }],
        source: vec![0.0; if plan.settings.radiance { values } else { 0 }],
        collided: vec![[[0.0; 3]; 2]; plan.scene.lights.len()],
    };
    let lights: Vec<Lit> = plan
        .lights
        .iter()
        .zip(views)
        .enumerate()
        .filter_map(|(light, (how, view))| match (how.direct, view) {
            (Direct::Quadrature { points, rays }, Some(view)) => Some(Lit { light, view, points, rays }),
            _ => None,
        })
        .collect();
    let wants_source = plan.settings.radiance && plan.wants_source();
    if lights.is_empty() || !(plan.settings.fluence || wants_source || quiet(plan)) {
        return Ok(sum);
    }
    let [_, ny, nz] = plan.scene.medium.volume.n();
    match device {
        Device::Cpu => {
            let extinction = plan.scene.medium.extinction.rgb.map(|e| e as f32);
            let find = |at: usize, cell: [usize; 3]| {
                let Lit { view, points, rays, .. } = lights[at];
                voxel_fluence(view, &extinction, (points, rays), cell.map(|c| c as i32))
            };
            sum.add(plan, &lights, 0..ny * nz, find, control);
        }
        #[cfg(feature = "gpu")]
        Device::Gpu(gpu) => {
            let mut quadratures = gpu::single::Quadratures::new(gpu, plan, &lights, quiet(plan), control)?;
            while let Some(rows) = quadratures.next_rows(control)? {
                sum.add(plan, &lights, rows, |at, cell| quadratures.of(at, cell), control);
            }
        }
    }
    Ok(sum)
}

/// Whether a light shoots no photons: the quadrature then says what collides of it.
pub fn quiet(plan: &Plan) -> bool {
    plan.lights.iter().any(|l| l.emission == Emission::Nothing)
}

/// The albedo of a voxel.
pub fn albedo_of(scene: &Scene, voxel: usize) -> [f64; 3] {
    match scene.medium.albedo {
        Albedo::Constant(a) => a.rgb,
        Albedo::PerVoxel(a) => [f64::from(a[voxel]); 3],
    }
}

/// The cosine between two unit vectors.
#[inline(always)]
pub fn cosine(a: V3, b: V3) -> f32 {
    (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]).clamp(-1.0, 1.0)
}

impl Single {
    /// Adds the light of some rows along x, `find` being the means of a light over a voxel.
    fn add(
        &mut self,
        plan: &Plan,
        lights: &[Lit],
        rows: Range<usize>,
        find: impl Fn(usize, [usize; 3]) -> Quadrature + Sync,
        control: &Control,
    ) {
        let scene = plan.scene;
        let volume = &scene.medium.volume;
        let (channels, n) = (plan.channels, volume.n());
        let h = volume.spacing().map(|c| c as f32);
        let eye = LocalEye::new(scene, &scene.camera);
        let quiet = quiet(plan);
        let row = n[0] * channels;
        let part = rows.start * row..rows.end * row;
        let fluence = self.fluence.get_mut(part.clone()).unwrap_or_default();
        let source = if plan.wants_source() { self.source.get_mut(part).unwrap_or_default() } else { &mut [] };
        let mut fluence_rows: Vec<Option<&mut [f32]>> = pad(fluence.chunks_mut(row), rows.len());
        let mut source_rows: Vec<Option<&mut [f32]>> = pad(source.chunks_mut(row), rows.len());
        let sums: Vec<Vec<[[f64; 3]; 2]>> = fluence_rows
            .par_iter_mut()
            .zip(source_rows.par_iter_mut())
            .zip(rows)
            .map(|((fluence, source), at)| {
                let mut sums = vec![[[0.0f64; 3]; 2]; if quiet { scene.lights.len() } else { 0 }];
                if control.stopped() {
                    return sums;
                }
                let (j, k) = (at % n[1], at / n[1]);
                for i in 0..n[0] {
                    let centre = [i, j, k].map(|c| c as f32 + 0.5);
                    for (l, lit) in lights.iter().enumerate() {
                        let Quadrature { fluence: phi, collisions } = find(l, [i, j, k]);
                        if let Some(row) = fluence {
                            (0..channels).for_each(|c| row[i * channels + c] += phi[c]);
                        }
                        if let Some(row) = source {
                            let toward = eye.from(centre, h);
                            let p = scene.medium.phase.pdf(cosine(toward, lit.view.incident(centre).direction));
                            (0..channels).for_each(|c| row[i * channels + c] += phi[c] * p);
                        }
                        if quiet {
                            let albedo = albedo_of(scene, at * n[0] + i);
                            for c in 0..3 {
                                let power =
                                    scene.medium.extinction.rgb[c] * f64::from(collisions[c]) * volume.voxel_volume();
                                sums[lit.light][0][c] += power * (1.0 - albedo[c]);
                                sums[lit.light][1][c] += power * albedo[c];
                            }
                        }
                    }
                }
                sums
            })
            .collect();
        for row in sums {
            for (total, sum) in self.collided.iter_mut().zip(row) {
                for (t, s) in total.iter_mut().flatten().zip(sum.iter().flatten()) {
                    *t += s;
                }
            }
        }
    }
}
