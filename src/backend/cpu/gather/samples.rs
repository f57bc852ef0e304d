//! How many rays a pixel takes: as many as voxels it spans, and more where an outline or a light is seen in it.

#[cfg(feature = "gpu")]
use super::Volumes;
use super::{Ray, View};
use crate::backend::cpu::light::{Illumination, Source};
use crate::scene::field::V3;
use crate::scene::{Camera, Scene};
use rayon::prelude::*;

/// Parts that a solid without voxels is seen in.
const SOLID: f64 = 16.0;

/// Rays per axis of all pixels, or of the given ones.
#[cfg(feature = "gpu")]
pub fn rays_per_axis(volumes: &Volumes, camera: &Camera, pixels: Option<&[usize]>) -> Vec<u8> {
    let view = View::<1, 1>::new(volumes);
    let [width, height] = camera.resolution;
    let fine = samples_per_axis(volumes.scene, camera);
    let corners = pixels.is_none().then(|| view.corner_hits(camera));
    let count = pixels.map_or(width * height, <[usize]>::len);
    (0..count)
        .into_par_iter()
        .with_min_len(256)
        .map(|at| {
            let pixel = pixels.map_or(at, |list| list[at]);
            let (x, y) = (pixel % width, pixel / width);
            let hits = view.at_corners(camera, corners.as_deref(), (x, y));
            let centre = view.range(camera, x as f64 + 0.5, y as f64 + 0.5);
            view.rays_per_axis(camera, centre.as_ref(), hits, fine) as u8
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
    /// Whether the ray through a pixel's upper left corner meets the box.
    fn hits(&self, camera: &Camera, x: usize, y: usize) -> bool {
        self.range(camera, x as f64, y as f64).is_some()
    }

    /// The same for all corners of the image's pixels, row by row.
    pub fn corner_hits(&self, camera: &Camera) -> Vec<bool> {
        let [width, height] = camera.resolution;
        let mut hits = vec![false; (width + 1) * (height + 1)];
        hits.par_chunks_mut(width + 1).enumerate().for_each(|(y, row)| {
            for (x, hit) in row.iter_mut().enumerate() {
                *hit = self.hits(camera, x, y);
            }
        });
        hits
    }

    /// Those of the corners of the pixel at (x, y), from those of all if these are known.
    #[inline(always)]
    pub fn at_corners(&self, camera: &Camera, corners: Option<&[bool]>, (x, y): (usize, usize)) -> [bool; 4] {
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(u, v)| match corners {
            Some(hits) => hits[(y + v) * (camera.resolution[0] + 1) + x + u],
            None => self.hits(camera, x + u, y + v),
        })
    }

    /// Rays per axis of a pixel with the given ray through its centre, of whose corners some meet the box.
    #[inline(always)]
    pub fn rays_per_axis(&self, camera: &Camera, centre: Option<&Ray>, hits: [bool; 4], fine: usize) -> usize {
        let edge = hits.contains(&true) && hits.contains(&false);
        let bright = match centre {
            Some(ray) => self.volumes.lights.iter().map(|light| self.sees(camera, ray, light)).fold(1, usize::max),
            None => 1,
        };
        fine.max(if edge { 8 } else { 1 }).max(bright)
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
