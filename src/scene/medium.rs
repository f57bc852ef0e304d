//! The medium: sigma_t = extinction * density [1/length], sigma_s = albedo * sigma_t, and a phase function.

use super::field::Field;
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

/// The source term L_e [radiance/length] in each voxel, interpolated as the density is; it shines where that is zero too.
#[derive(Debug, Clone)]
pub struct Emission<'a> {
    /// One plane of voxels per channel, x fastest.
    planes: Vec<&'a [f32]>,
    /// Sums over all voxels.
    sums: [f64; 3],
}

impl<'a> Emission<'a> {
    /// From one plane of all voxels or three (RGB), one after the other: finite, not negative. The error counts the bad
    /// ones and gives the first index (k, j, i), or (k, j, i, channel).
    pub fn new(values: &'a [f32], channels: usize, volume: &Volume) -> Result<Self> {
        let voxels = volume.voxels();
        if !matches!(channels, 1 | 3) || values.len() != voxels * channels {
            return scene_error(format!(
                "emission has {} values in {channels} channels and the volume {voxels} voxels; each needs 1 or 3 (RGB)",
                values.len()
            ));
        }
        let bad = |v: &&f32| !(v.is_finite() && **v >= 0.0);
        if let Some(first) = values.iter().position(|v| bad(&v)) {
            let (count, n, at) = (values.iter().filter(bad).count(), volume.n(), first % voxels);
            let (k, j, i) = (at / (n[0] * n[1]), at / n[0] % n[1], at % n[0]);
            let channel = if channels > 1 { format!(", {}", first / voxels) } else { String::new() };
            return scene_error(format!(
                "{count} values of emission are NaN, infinite or negative, the first at index ({k}, {j}, {i}{channel}): {}",
                values[first]
            ));
        }
        let radiance = f64::from(values.iter().copied().fold(0.0, f32::max)) * volume.size().iter().sum::<f64>();
        if radiance > 1e30 {
            return scene_error(format!("emission * size reaches a radiance of {radiance:e}; up to 1e30 is allowed"));
        }
        let planes: Vec<&[f32]> = values.chunks(voxels).collect();
        let sums = std::array::from_fn(|c| planes[c % channels].iter().map(|&v| f64::from(v)).sum());
        Ok(Emission { planes, sums })
    }

    /// The same source term, with its values at another place in memory.
    pub fn holding<'b>(&self, values: &'b [f32]) -> Emission<'b> {
        let size = values.len() / self.planes.len();
        let planes = (0..self.planes.len()).map(|c| &values[c * size..(c + 1) * size]).collect();
        Emission { planes, sums: self.sums }
    }

    /// 1, or 3 if it is RGB.
    pub fn channels(&self) -> usize {
        self.planes.len()
    }

    /// The source term of a channel.
    pub fn field(&self, channel: usize, volume: &Volume) -> Field<'a> {
        Field::new(self.planes[channel % self.planes.len()], volume)
    }

    /// The mean over the box, by channel.
    pub fn means(&self, volume: &Volume) -> [f64; 3] {
        self.sums.map(|sum| sum / volume.voxels() as f64)
    }

    /// What the medium emits [W], by channel: 4 pi times the volume integral of the source term. Each voxel has the mass 1
    /// in that, with interpolation (clamped at the border) too.
    pub fn power(&self, volume: &Volume) -> [f64; 3] {
        self.sums.map(|sum| 4.0 * std::f64::consts::PI * sum * volume.voxel_volume())
    }
}

/// The arrays that a medium reads: empty where it has a number, or nothing, in their place.
#[derive(Debug, Clone, Copy, Default)]
pub struct Voxels<'a> {
    /// Densities.
    pub density: &'a [f32],
    /// Albedos.
    pub albedo: &'a [f32],
    /// Planes of the source term.
    pub emission: &'a [f32],
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
    /// What it emits by itself.
    pub emission: Option<Emission<'a>>,
    max_albedo: f64,
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
        let max_albedo = match albedo {
            Albedo::Constant(a) => a.max(),
            Albedo::PerVoxel(a) => f64::from(a.iter().copied().fold(0.0f32, f32::max)),
        };
        let depth = extinction.max() * f64::from(volume.max()) * volume.size().iter().sum::<f64>();
        if !(depth < 1e12) {
            return scene_error(format!(
                "extinction * density * size reaches an optical depth of {depth:e}; below 1e12 is allowed"
            ));
        }
        Ok(Medium { volume, extinction, albedo, phase, emission: None, max_albedo })
    }

    /// The same medium, with its voxels at another place in memory.
    pub fn holding<'b>(&self, voxels: &Voxels<'b>) -> Medium<'b> {
        Medium {
            volume: self.volume.holding(voxels.density),
            extinction: self.extinction,
            albedo: match self.albedo {
                Albedo::Constant(a) => Albedo::Constant(a),
                Albedo::PerVoxel(_) => Albedo::PerVoxel(voxels.albedo),
            },
            phase: self.phase.clone(),
            emission: self.emission.as_ref().map(|emission| emission.holding(voxels.emission)),
            max_albedo: self.max_albedo,
        }
    }

    /// The same medium, which emits.
    pub fn emitting(self, emission: Option<Emission<'a>>) -> Self {
        Medium { emission, ..self }
    }

    /// Whether the absorption coefficient varies within voxels: what is absorbed in one is then not its mean fluence times
    /// the coefficient at its centre.
    pub fn absorbs_unevenly(&self) -> bool {
        let varies = match self.albedo {
            Albedo::Constant(a) => !self.volume.is_constant() && a.rgb.iter().any(|&a| a < 1.0),
            Albedo::PerVoxel(_) => true,
        };
        varies && self.volume.linear() && self.max_sigma_t() > 0.0
    }

    /// Whether a coefficient was given as RGB.
    pub fn is_rgb(&self) -> bool {
        self.extinction.is_rgb
            || matches!(self.albedo, Albedo::Constant(a) if a.is_rgb)
            || self.emission.as_ref().is_some_and(|emission| emission.channels() > 1)
    }

    /// Whether the channels differ in extinction.
    pub fn is_chromatic(&self) -> bool {
        !self.extinction.is_grey()
    }

    /// Largest albedo anywhere.
    pub fn max_albedo(&self) -> f64 {
        self.max_albedo
    }

    /// Largest extinction coefficient anywhere [1/length].
    pub fn max_sigma_t(&self) -> f64 {
        self.extinction.max() * f64::from(self.volume.max())
    }
}
