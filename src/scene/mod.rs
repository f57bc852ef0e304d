//! What is simulated. Constructors validate, so a [`Scene`] that exists is valid; everything in it is relative to the
//! box's lower corner, in f64.

pub mod camera;
pub mod environment;
pub mod eye;
pub mod field;
pub mod light;
pub mod medium;
pub mod ray;
pub mod volume;

pub use camera::Camera;
pub use light::Light;
pub use medium::{Albedo, Emission, Medium, Voxels};
pub use ray::ViewRay;
pub use volume::Volume;

use crate::error::{Result, scene_error};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// One value, or one per colour channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spectrum {
    /// Red, green, blue; equal for a grey value.
    pub rgb: [f64; 3],
    /// Whether it was given as RGB.
    pub is_rgb: bool,
}

impl Spectrum {
    /// From one or three finite, non-negative numbers; `what` names it in the error.
    pub fn new(values: &[f64], what: &str) -> Result<Self> {
        if let Some(v) = values.iter().find(|v| !(**v >= 0.0 && **v <= 1e30)) {
            return scene_error(format!(
                "{what} = {v} is not allowed; it must be finite and not negative (up to 1e30)"
            ));
        }
        match *values {
            [v] => Ok(Spectrum { rgb: [v; 3], is_rgb: false }),
            [r, g, b] => Ok(Spectrum { rgb: [r, g, b], is_rgb: true }),
            _ => scene_error(format!("{what} has {} values; 1 or 3 (RGB) are allowed", values.len())),
        }
    }

    /// The largest channel.
    pub fn max(&self) -> f64 {
        self.rgb[0].max(self.rgb[1]).max(self.rgb[2])
    }

    /// Whether all channels are equal.
    pub fn is_grey(&self) -> bool {
        self.rgb[0] == self.rgb[1] && self.rgb[1] == self.rgb[2]
    }
}

/// A medium, the lights on it, and the camera that looks at it.
#[derive(Debug, Clone)]
pub struct Scene<'a> {
    /// The medium in its box.
    pub medium: Medium<'a>,
    /// The lights; they add up.
    pub lights: Vec<Light>,
    /// The eye that anisotropic media are recorded towards.
    pub camera: Camera,
    /// A number that no other scene has: devices know by it what they keep of one.
    pub id: u64,
}

impl<'a> Scene<'a> {
    /// Assembles validated parts.
    pub fn new(medium: Medium<'a>, lights: Vec<Light>, camera: Camera) -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        Scene { medium, lights, camera, id: NEXT.fetch_add(1, Relaxed) }
    }

    /// The same scene, with its voxels at another place in memory: so it is kept while nobody holds them.
    pub fn holding<'b>(&self, voxels: &Voxels<'b>) -> Scene<'b> {
        let medium = self.medium.holding(voxels);
        Scene { medium, lights: self.lights.clone(), camera: self.camera, id: self.id }
    }

    /// 3 if anything is RGB, else 1.
    pub fn channels(&self) -> usize {
        let rgb = self.medium.is_rgb() || self.lights.iter().any(|l| l.value().is_rgb);
        if rgb { 3 } else { 1 }
    }
}

/// The largest density in each block of `block`^3 voxels and up to `reach` voxels around it, x fastest. A lookup with
/// interpolation reaches one voxel over the block, one of the nearest voxel none: [`Volume::reach`].
pub fn block_maxima(volume: &Volume, block: usize, reach: usize) -> Vec<f32> {
    let m = volume.n();
    let n = m.map(|extent| extent.div_ceil(block));
    let range =
        |cell: usize, axis: usize| (cell * block).saturating_sub(reach)..((cell + 1) * block + reach).min(m[axis]);
    // Axis by axis: along each row of a slice, then over its rows; at last over the slices.
    let larger = |mine: &mut [f32], other: &[f32]| {
        for (a, b) in mine.iter_mut().zip(other) {
            *a = if *b > *a { *b } else { *a };
        }
    };
    let mut slices = vec![0.0f32; m[2] * n[1] * n[0]];
    slices.par_chunks_mut(n[1] * n[0]).enumerate().for_each_init(
        || vec![0.0f32; m[1] * n[0]],
        |rows, (k, slice)| {
            for (j, row) in rows.chunks_mut(n[0]).enumerate() {
                let first = (k * m[1] + j) * m[0];
                for (cell, top) in row.iter_mut().enumerate() {
                    let x = range(cell, 0);
                    let values = &volume.density()[first + x.start..first + x.end];
                    *top = values.iter().fold(0.0, |top, &d| if d > top { d } else { top });
                }
            }
            for (cell, tops) in slice.chunks_mut(n[0]).enumerate() {
                range(cell, 1).for_each(|j| larger(tops, &rows[j * n[0]..(j + 1) * n[0]]));
            }
        },
    );
    let mut maxima = vec![0.0f32; n[2] * n[1] * n[0]];
    let size = n[1] * n[0];
    maxima.par_chunks_mut(size).enumerate().for_each(|(cell, tops)| {
        range(cell, 2).for_each(|k| larger(tops, &slices[k * size..(k + 1) * size]));
    });
    maxima
}

/// A finite point or vector, or an error that names it.
pub(crate) fn finite(v: [f64; 3], what: &str) -> Result<[f64; 3]> {
    if v.iter().all(|c| c.abs() <= 1e15) {
        Ok(v)
    } else {
        scene_error(format!("{what} = {v:?} is not allowed; each component must be finite (up to 1e15)"))
    }
}

/// A unit vector from a finite, non-zero one.
pub(crate) fn direction(v: [f64; 3], what: &str) -> Result<[f64; 3]> {
    if v.iter().any(|c| !c.is_finite()) {
        return scene_error(format!("{what} = {v:?} is not finite"));
    }
    // Scaled first, so that neither tiny nor huge components lose the length.
    let scale = v.iter().fold(0.0f64, |m, c| m.max(c.abs()));
    if scale == 0.0 {
        return scene_error(format!("{what} = {v:?} has no length; a non-zero direction is needed"));
    }
    let v = v.map(|c| c / scale);
    let norm = v.iter().map(|c| c * c).sum::<f64>().sqrt();
    Ok(v.map(|c| c / norm))
}
