//! Cameras: where the ray of a point on the image starts, and where it goes.

use super::{direction, finite};
use crate::error::{Result, scene_error};

/// The closed set of projections.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// All rays start at the eye; the half width of the image plane at distance 1.
    Perspective {
        /// tan(fov / 2), fov along x.
        half_width: f64,
    },
    /// All rays are parallel; the half width of the image in world units.
    Orthographic {
        /// Half of the image's width.
        half_width: f64,
    },
}

/// A camera in world coordinates; row 0 of its image is the top.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// The eye, or the centre of the orthographic image plane.
    pub origin: [f64; 3],
    forward: [f64; 3],
    right: [f64; 3],
    up: [f64; 3],
    /// The axis that is up instead of what was given, where the view is along that.
    stand_in: Option<usize>,
    projection: Projection,
    /// Image width and height in pixels.
    pub resolution: [usize; 2],
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

impl Camera {
    fn look(
        name: &str,
        origin: [f64; 3],
        target: [f64; 3],
        up: [f64; 3],
        resolution: [usize; 2],
        projection: Projection,
    ) -> Result<Self> {
        let origin = finite(origin, &format!("{name}: origin"))?;
        let target = finite(target, &format!("{name}: target"))?;
        if origin == target {
            return scene_error(format!("{name}: origin and target are the same point {origin:?}"));
        }
        if resolution.iter().any(|&r| r == 0 || r > 65_536) {
            return scene_error(format!("{name}: resolution = {resolution:?} is not allowed; each must be 1 to 65536"));
        }
        let forward = direction(std::array::from_fn(|a| target[a] - origin[a]), &format!("{name}: target - origin"))?;
        let mut up = direction(up, &format!("{name}: up"))?;
        let mut stand_in = None;
        if direction(cross(forward, up), "").is_err() || cross(forward, up).iter().all(|c| c.abs() < 1e-9) {
            // A view along `up` takes the axis that it is least along.
            let axis = (0..3).min_by(|&a, &b| forward[a].abs().total_cmp(&forward[b].abs())).unwrap_or(0);
            up = std::array::from_fn(|a| f64::from(u8::from(a == axis)));
            stand_in = Some(axis);
        }
        let right = direction(cross(forward, up), &format!("{name}: up"))?;
        Ok(Camera { origin, forward, right, up: cross(right, forward), stand_in, projection, resolution })
    }

    /// A pinhole at `origin`; `fov` in degrees along x, within (0, 180).
    pub fn perspective(
        origin: [f64; 3],
        target: [f64; 3],
        up: [f64; 3],
        fov: f64,
        resolution: [usize; 2],
    ) -> Result<Self> {
        if !(fov > 0.0 && fov < 180.0) {
            return scene_error(format!("PerspectiveCamera: fov = {fov} is not allowed; it must be within (0, 180)"));
        }
        let half_width = (0.5 * fov.to_radians()).tan();
        Self::look("PerspectiveCamera", origin, target, up, resolution, Projection::Perspective { half_width })
    }

    /// Parallel rays through an image plane of the given width, which starts at `origin`.
    pub fn orthographic(
        origin: [f64; 3],
        target: [f64; 3],
        up: [f64; 3],
        width: f64,
        resolution: [usize; 2],
    ) -> Result<Self> {
        if !(width.is_finite() && width > 0.0) {
            return scene_error(format!("OrthographicCamera: width = {width} is not allowed; it must be positive"));
        }
        let projection = Projection::Orthographic { half_width: 0.5 * width };
        Self::look("OrthographicCamera", origin, target, up, resolution, projection)
    }

    /// The name of the axis that is up, where the view is along the `up` that was given.
    pub fn up_stand_in(&self) -> Option<&'static str> {
        self.stand_in.map(|axis| ["x", "y", "z"][axis])
    }

    /// Origin and unit direction of the ray through (x, y) in pixels, (0, 0) at the upper left corner.
    #[inline]
    pub fn ray(&self, x: f64, y: f64) -> ([f64; 3], [f64; 3]) {
        let [width, height] = self.resolution.map(|r| r as f64);
        let u = 2.0 * x / width - 1.0;
        let v = (height - 2.0 * y) / width;
        match self.projection {
            Projection::Perspective { half_width } => {
                let d: [f64; 3] =
                    std::array::from_fn(|a| self.forward[a] + half_width * (u * self.right[a] + v * self.up[a]));
                let norm = d.iter().map(|c| c * c).sum::<f64>().sqrt();
                (self.origin, d.map(|c| c / norm))
            }
            Projection::Orthographic { half_width } => {
                let o = std::array::from_fn(|a| self.origin[a] + half_width * (u * self.right[a] + v * self.up[a]));
                (o, self.forward)
            }
        }
    }

    /// The direction ahead, and what a pixel to the right and one down add to it: to the direction of a ray not yet of
    /// unit length, or, where rays are parallel, to its start.
    pub fn axes(&self) -> [[f64; 3]; 3] {
        let (Projection::Perspective { half_width } | Projection::Orthographic { half_width }) = self.projection;
        let pixel = 2.0 * half_width / self.resolution[0] as f64;
        [self.forward, self.right.map(|c| pixel * c), self.up.map(|c| -pixel * c)]
    }

    /// The columns and rows of pixels outside of which nothing of a box is seen: (first, last + 1) of each.
    pub fn window(&self, low: [f64; 3], size: [f64; 3]) -> [(usize, usize); 2] {
        let corners = (0..8).map(|i| self.project(std::array::from_fn(|a| low[a] + size[a] * f64::from(i >> a & 1))));
        let Some(corners) = corners.collect::<Option<Vec<_>>>() else {
            // Something is behind the eye.
            return self.resolution.map(|m| (0, m));
        };
        std::array::from_fn(|axis| {
            let ends = corners
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), c| (low.min(c[axis]), high.max(c[axis])));
            let first = (ends.0 - 1e-6).floor().clamp(0.0, self.resolution[axis] as f64) as usize;
            (first, (ends.1 + 1e-6).ceil().clamp(0.0, self.resolution[axis] as f64) as usize)
        })
    }

    /// Where a point is seen, in pixels from the upper left corner; `None` behind the eye.
    pub fn project(&self, point: [f64; 3]) -> Option<[f64; 2]> {
        let r: [f64; 3] = std::array::from_fn(|a| point[a] - self.origin[a]);
        let dot = |axis: &[f64; 3]| (0..3).map(|a| r[a] * axis[a]).sum::<f64>();
        let [width, height] = self.resolution.map(|r| r as f64);
        let depth = dot(&self.forward);
        let scale = match self.projection {
            Projection::Perspective { half_width } => half_width * depth,
            Projection::Orthographic { half_width } => half_width,
        };
        let (u, v) = (dot(&self.right) / scale, dot(&self.up) / scale);
        (depth > 0.0).then_some([0.5 * (u + 1.0) * width, 0.5 * (height - v * width)])
    }

    /// The direction from a point towards the eye is `eye - point` normalised; for parallel views it is constant.
    pub fn eye(&self) -> Eye {
        match self.projection {
            Projection::Perspective { .. } => Eye::Point(self.origin),
            Projection::Orthographic { .. } => Eye::Direction(self.forward.map(|c| -c)),
        }
    }

    /// The same view in no more than about `most` pixels.
    pub fn coarse(&self, most: usize) -> Self {
        let [width, height] = self.resolution.map(|m| m as f64);
        let scale = (most as f64 / (width * height)).sqrt().min(1.0);
        Camera { resolution: [width, height].map(|m| (m * scale).round().max(1.0) as usize), ..*self }
    }

    /// The width of a pixel at the given distance from the eye.
    pub fn pixel_width(&self, distance: f64) -> f64 {
        let half = match self.projection {
            Projection::Perspective { half_width } => half_width * distance,
            Projection::Orthographic { half_width } => half_width,
        };
        2.0 * half / self.resolution[0] as f64
    }

    /// A camera that sees the whole box of the given size at the given origin from a corner above it, 600 x 600: its
    /// origin, its target and its fov in degrees.
    pub fn framing(origin: [f64; 3], size: [f64; 3]) -> ([f64; 3], [f64; 3], f64) {
        let centre: [f64; 3] = std::array::from_fn(|a| origin[a] + 0.5 * size[a]);
        let radius = 0.5 * size.iter().map(|c| c * c).sum::<f64>().sqrt();
        let fov: f64 = 40.0;
        let distance = radius / (0.5 * fov.to_radians()).sin() * 0.95;
        let view = [0.40, -0.82, 0.41];
        let norm = view.iter().map(|c: &f64| c * c).sum::<f64>().sqrt();
        (std::array::from_fn(|a| centre[a] + distance * view[a] / norm), centre, fov)
    }
}

/// Where light must go to be seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Eye {
    /// Towards a point in the world.
    Point([f64; 3]),
    /// Along a direction.
    Direction([f64; 3]),
}
