//! View rays: the part of a camera's ray that lies within the medium.

use super::field::V3;
use super::{Camera, Scene};
use crate::physics::flight::{ball_range, box_range};

/// A view ray within the medium.
#[derive(Debug, Clone, Copy)]
pub struct ViewRay {
    /// Where it enters, in voxels; at the eye if that is within.
    pub p: V3,
    /// Voxels per length.
    pub v: V3,
    /// Unit direction away from the eye.
    pub direction: V3,
    /// Length from the eye to the entry.
    pub start: f64,
    /// Length within.
    pub length: f32,
}

impl ViewRay {
    /// The ray through a point of the image, (0, 0) being its upper left corner; `None` if it misses the medium.
    #[inline]
    pub fn new(scene: &Scene, camera: &Camera, x: f64, y: f64) -> Option<Self> {
        let volume = &scene.medium.volume;
        let (origin, direction) = camera.ray(x, y);
        let (local, h) = (volume.local(origin), volume.spacing());
        let n = volume.n().map(|m| m as f64);
        let p: [f64; 3] = std::array::from_fn(|a| local[a] / h[a]);
        let v: [f64; 3] = std::array::from_fn(|a| direction[a] / h[a]);
        let (t0, t1) = if volume.is_ball() { ball_range(p, v, 0.5) } else { box_range(p, v, n) }?;
        let t0 = t0.max(0.0);
        (t1 > t0).then(|| ViewRay {
            p: std::array::from_fn(|a| (p[a] + v[a] * t0).clamp(0.0, n[a]) as f32),
            v: v.map(|c| c as f32),
            direction: direction.map(|c| c as f32),
            start: t0,
            length: (t1 - t0) as f32,
        })
    }
}
