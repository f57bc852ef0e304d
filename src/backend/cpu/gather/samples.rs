//! The rays of a pixel: as many as voxels it spans, and more where an outline or a light is seen in it.

#[cfg(feature = "gpu")]
use super::Volumes;
use super::outline::Outline;
use super::{Ray, View};
use crate::backend::cpu::light::{Illumination, Source};
use crate::scene::field::V3;
use crate::scene::{Camera, Scene};
#[cfg(feature = "gpu")]
use rayon::prelude::*;

/// Parts that a solid without voxels is seen in.
const SOLID: f64 = 16.0;

/// The rays of a pixel.
#[derive(Debug, Clone, Copy)]
pub struct Rays {
    /// Rays per axis.
    pub per_axis: usize,
    /// The part of the pixel that the medium covers, where its outline runs through it.
    pub covered: Option<f64>,
}

/// The rays of all pixels, or of the given ones.
#[cfg(feature = "gpu")]
pub fn rays(volumes: &Volumes, camera: &Camera, outline: &Outline, pixels: Option<&[usize]>) -> Vec<Rays> {
    let view = View::<1, 1>::new(volumes);
    let [width, height] = camera.resolution;
    let fine = samples_per_axis(volumes.scene, camera);
    let count = pixels.map_or(width * height, <[usize]>::len);
    (0..count)
        .into_par_iter()
        .with_min_len(256)
        .map(|at| {
            let pixel = pixels.map_or(at, |list| list[at]);
            let (x, y) = ((pixel % width) as f64, (pixel / width) as f64);
            let centre = view.range(camera, x + 0.5, y + 0.5);
            view.rays(camera, centre.as_ref(), (outline, x, y), fine)
        })
        .collect()
}

/// Rays per pixel and axis: as many as voxels that a pixel spans, so that a pixel is the mean over its area.
pub fn samples_per_axis(scene: &Scene, camera: &Camera) -> usize {
    let volume = &scene.medium.volume;
    let (size, eye) = (volume.size(), volume.local(camera.origin));
    let radius = 0.5 * size.iter().map(|s| s * s).sum::<f64>().sqrt();
    // From within, what is seen lies at about half the radius.
    let distance = (0..3).map(|a| (eye[a] - 0.5 * size[a]).powi(2)).sum::<f64>().sqrt().max(0.5 * radius);
    let h = volume.spacing().into_iter().fold(f64::INFINITY, f64::min);
    // What a single voxel shows is its outline and the lengths of its chords.
    let h = if volume.voxels() == 1 { h / SOLID } else { h };
    let voxels = camera.pixel_width(distance) / h;
    // Two rays per voxel resolve what is linear between centres; constant voxels have edges in any pixel.
    let smooth = volume.linear() || volume.is_constant();
    let (per_voxel, least, most) = if smooth { (2.0, 1.0, 4.0) } else { (6.0, 2.0, 6.0) };
    (per_voxel * voxels).ceil().clamp(least, most) as usize
}

impl<const C: usize, const S: usize> View<'_, C, S> {
    /// The rays of the pixel with the upper left corner (x, y) and the given ray through its centre.
    #[inline(always)]
    pub fn rays(
        &self,
        camera: &Camera,
        centre: Option<&Ray>,
        (outline, x, y): (&Outline, f64, f64),
        fine: usize,
    ) -> Rays {
        let area = outline.cover(x, y);
        let covered = (area > 0.0 && area < 1.0).then_some(area);
        let bright = match centre {
            Some(ray) => self.volumes.lights.iter().map(|light| self.sees(camera, ray, light)).fold(1, usize::max),
            None => 1,
        };
        let per_axis = fine.max(bright);
        Rays { per_axis: covered.map_or(per_axis, |area| outline.rays((x, y), area, per_axis)), covered }
    }

    /// Rays per axis that a pixel needs because a point light in the box stands near its line of sight: 1/d^2 is steep.
    fn sees(&self, camera: &Camera, ray: &Ray, light: &Illumination) -> usize {
        let Source::Point(position) = light.source else { return 1 };
        let Ray { p, direction: d, length, .. } = *ray;
        let to: V3 = std::array::from_fn(|a| (position[a] - p[a]) * self.h[a] as f32);
        let t = (0..3).map(|a| to[a] * d[a]).sum::<f32>();
        let off = (0..3).map(|a| (to[a] - t * d[a]).powi(2)).sum::<f32>().sqrt();
        let pixel = camera.pixel_width(f64::from(t.clamp(0.0, length))) as f32;
        if t <= 0.0 || t >= length {
            return 1;
        }
        match off / pixel {
            o if o < 2.0 => 16,
            o if o < 8.0 => 4,
            o if o < 32.0 => 2,
            _ => 1,
        }
    }
}
