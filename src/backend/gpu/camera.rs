//! A camera as kernels see it.

use crate::scene::camera::Eye;
use crate::scene::{Camera, Scene};
use bytemuck::{Pod, Zeroable};

/// `View` of `shaders/camera.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[expect(missing_docs, reason = "the shader names and describes them")]
pub struct View {
    pub passing: [f32; 3],
    pub depth: f32,
    pub passing_x: [f32; 3],
    pub pixel: f32,
    pub passing_y: [f32; 3],
    pub width: u32,
    pub ahead: [f32; 3],
    pub column: i32,
    pub ahead_x: [f32; 3],
    pub row: i32,
    pub ahead_y: [f32; 3],
    pub spare: u32,
}

impl View {
    /// What a camera sees of a scene.
    pub fn new(scene: &Scene, camera: &Camera) -> Self {
        let volume = &scene.medium.volume;
        let (h, size) = (volume.spacing(), volume.size());
        let eye = volume.local(camera.origin);
        let [forward, x, y] = camera.axes();
        let to: [f64; 3] = std::array::from_fn(|a| 0.5 * size[a] - eye[a]);
        let [radius, distance] = [size.map(|s| 0.5 * s), to].map(|r| r.iter().map(|c| c * c).sum::<f64>().sqrt());
        let depth = (0..3).map(|a| to[a] * forward[a]).sum::<f64>();
        let centre = volume.world(size.map(|s| 0.5 * s));
        let middle = camera.resolution.map(|m| 0.5 * m as f64);
        let seen = camera.project(centre).unwrap_or(middle);
        let [column, row]: [f64; 2] = std::array::from_fn(|a| seen[a].floor().clamp(0.0, camera.resolution[a] as f64));
        // What that pixel's ray adds to the direction ahead, or to its start.
        let aside: [f64; 3] = std::array::from_fn(|a| (column - middle[0]) * x[a] + (row - middle[1]) * y[a]);
        let ahead: [f64; 3] = std::array::from_fn(|a| forward[a] + aside[a]);
        let voxels = |v: [f64; 3]| -> [f32; 3] { std::array::from_fn(|a| (v[a] / h[a]) as f32) };
        let single = |v: [f64; 3]| v.map(|c| c as f32);
        let common = View {
            pixel: camera.pixel_width(1.0) as f32,
            width: camera.resolution[0] as u32,
            column: column as i32,
            row: row as i32,
            ..View::default()
        };
        match camera.eye() {
            Eye::Point(_) => {
                // From the box's neighbourhood the eye itself is near enough.
                let depth = if depth <= 0.0 || distance < 4.0 * radius { 0.0 } else { depth };
                View {
                    passing: voxels(std::array::from_fn(|a| eye[a] + depth * ahead[a])),
                    depth: depth as f32,
                    passing_x: voxels(x.map(|c| depth * c)),
                    passing_y: voxels(y.map(|c| depth * c)),
                    ahead: single(ahead),
                    ahead_x: single(x),
                    ahead_y: single(y),
                    ..common
                }
            }
            Eye::Direction(_) => View {
                passing: voxels(std::array::from_fn(|a| eye[a] + aside[a] + depth * forward[a])),
                depth: depth as f32,
                passing_x: voxels(x),
                passing_y: voxels(y),
                ahead: single(forward),
                ..common
            },
        }
    }

    /// The shader file of a camera's kind.
    pub fn file(camera: &Camera) -> &'static str {
        match camera.eye() {
            Eye::Point(_) => "camera_perspective",
            Eye::Direction(_) => "camera_orthographic",
        }
    }
}
