//! The medium: sigma_t = extinction * density [1/length], sigma_s = albedo * sigma_t, and a phase function.

use super::{Spectrum, Volume};
use crate::error::{Result, scene_error};
use crate::physics::Phase;

/// The fraction of extinction that scatters.
#[derive(Debug, Clone, Copy)]
pub enum Albedo<'a> {
    /// One value, or one per channel.
    Constant(Spectrum),
    /// One value per voxel, interpolated as the density is.
    PerVoxel(&'a [f32]),
}

/// A participating medium in a voxel box.
#[derive(Debug, Clone)]
pub struct Medium<'a> {
    /// The box and its densities.
    pub volume: Volume<'a>,
    /// sigma_t per unit of density [1/length].
    pub extinction: Spectrum,
    /// Albedo, within [0, 1].
    pub albedo: Albedo<'a>,
    /// The phase function.
    pub phase: Phase,
}

impl<'a> Medium<'a> {
    /// Checks the albedo's range and that every optical depth stays a finite number.
    pub fn new(volume: Volume<'a>, extinction: Spectrum, albedo: Albedo<'a>, phase: Phase) -> Result<Self> {
        match albedo {
            Albedo::Constant(a) => {
                if let Some(v) = a.rgb.iter().find(|v| **v > 1.0) {
                    return scene_error(format!("albedo = {v} is not allowed; it must be within [0, 1]"));
                }
            }
            Albedo::PerVoxel(a) => {
                if a.len() != volume.voxels() {
                    return scene_error(format!(
                        "albedo has {} voxels and the volume {}; their shapes must be equal",
                        a.len(),
                        volume.voxels()
                    ));
                }
                let bad = |v: &&f32| !(**v >= 0.0 && **v <= 1.0);
                if let Some(first) = a.iter().position(|v| bad(&v)) {
                    let (count, n) = (a.iter().filter(bad).count(), volume.n());
                    let (k, j, i) = (first / (n[0] * n[1]), first / n[0] % n[1], first % n[0]);
                    return scene_error(format!(
                        "{count} albedos are outside [0, 1], the first at index ({k}, {j}, {i}): {}",
                        a[first]
                    ));
                }
            }
        }
        let depth = extinction.max() * f64::from(volume.max()) * volume.size().iter().sum::<f64>();
        if !(depth < 1e12) {
            return scene_error(format!(
                "extinction * density * size reaches an optical depth of {depth:e}; below 1e12 is allowed"
            ));
        }
        Ok(Medium { volume, extinction, albedo, phase })
    }

    /// Whether a coefficient was given as RGB.
    pub fn is_rgb(&self) -> bool {
        self.extinction.is_rgb || matches!(self.albedo, Albedo::Constant(a) if a.is_rgb)
    }

    /// Whether the channels differ in extinction.
    pub fn is_chromatic(&self) -> bool {
        !self.extinction.is_grey()
    }

    /// Largest albedo anywhere.
    pub fn max_albedo(&self) -> f64 {
        match self.albedo {
            Albedo::Constant(a) => a.max(),
            Albedo::PerVoxel(a) => f64::from(a.iter().copied().fold(0.0f32, f32::max)),
        }
    }

    /// Largest extinction coefficient anywhere [1/length].
    pub fn max_sigma_t(&self) -> f64 {
        self.extinction.max() * f64::from(self.volume.max())
    }
}
