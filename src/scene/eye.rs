//! Where light is recorded towards: the eye of a camera, as seen from the voxels.

use super::camera::Eye;
use super::field::V3;
use super::{Camera, Scene};

/// The eye in voxel coordinates.
#[derive(Debug, Clone, Copy)]
pub enum LocalEye {
    /// A point.
    Point(V3),
    /// A direction towards it.
    Direction(V3),
}

impl LocalEye {
    /// The eye of a camera.
    pub fn new(scene: &Scene, camera: &Camera) -> Self {
        let volume = &scene.medium.volume;
        match camera.eye() {
            Eye::Point(world) => {
                let (p, h) = (volume.local(world), volume.spacing());
                LocalEye::Point(std::array::from_fn(|a| (p[a] / h[a]) as f32))
            }
            Eye::Direction(d) => LocalEye::Direction(d.map(|c| c as f32)),
        }
    }

    /// The unit vector from a point towards the eye.
    #[inline(always)]
    pub fn from(&self, p: V3, h: V3) -> V3 {
        match self {
            LocalEye::Direction(d) => *d,
            LocalEye::Point(eye) => {
                let r: V3 = std::array::from_fn(|a| (eye[a] - p[a]) * h[a]);
                let norm = (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]).sqrt().max(1e-30);
                r.map(|c| c / norm)
            }
        }
    }
}
