//! The medium's outline in the image: which part of a pixel's area it covers.

use super::points::{point, stride};
use crate::scene::camera::Eye;
use crate::scene::{Camera, Scene};
use std::f64::consts::{PI, TAU};

/// Planes that touch a ball all around.
const TANGENTS: usize = 64;

type World = [f64; 3];

fn dot(a: World, b: World) -> f64 {
    (0..3).map(|c| a[c] * b[c]).sum()
}

fn cross(a: World, b: World) -> World {
    std::array::from_fn(|c| a[(c + 1) % 3] * b[(c + 2) % 3] - a[(c + 2) % 3] * b[(c + 1) % 3])
}

fn less(a: World, b: World) -> World {
    std::array::from_fn(|c| a[c] - b[c])
}

fn unit(a: World) -> World {
    a.map(|c| c / dot(a, a).sqrt())
}

/// A convex region of the image: where all of `sides`, the distances `a x + b y + c` inwards from lines, are positive [pixels].
/// Without any it is the whole image, as seen from within.
pub struct Outline {
    sides: Vec<[f64; 3]>,
}

/// Rays per axis of a pixel that an outline runs through, and the most where it covers little.
const RAYS: usize = 8;
const FINEST: usize = 32;
/// The most that are tried until some meet what is covered and some do not, if neither is less than this part of the pixel.
const MOST: usize = 48;
const SLIVER: f64 = 1e-4;

impl Outline {
    /// That of the medium. Every plane through the eye that touches it is a line in the image.
    pub fn new(scene: &Scene, camera: &Camera) -> Self {
        let volume = &scene.medium.volume;
        let [ahead, right, down] = camera.axes();
        let middle = camera.resolution.map(|m| 0.5 * m as f64);
        // From the box's lower corner.
        let (origin, size) = (volume.local(camera.origin), volume.size());
        let centre = size.map(|s| 0.5 * s);
        // The inner side of the plane through a point of the outline and the eye, given its normal.
        let side = |point: World, normal: World| {
            let inwards = match camera.eye() {
                Eye::Point(_) => dot(normal, less(centre, origin)),
                Eye::Direction(_) => dot(normal, less(centre, point)),
            };
            let n = normal.map(|c| c * inwards.signum());
            let at_middle = match camera.eye() {
                Eye::Point(_) => dot(n, ahead),
                Eye::Direction(_) => dot(n, less(origin, point)),
            };
            let (x, y) = (dot(n, right), dot(n, down));
            let unit = 1.0 / x.hypot(y).max(f64::MIN_POSITIVE);
            let side = [x, y, at_middle - x * middle[0] - y * middle[1]].map(|c| c * unit);
            side.iter().all(|c| c.is_finite()).then_some(side).filter(|_| inwards != 0.0)
        };
        if volume.is_ball() {
            return Outline { sides: ball(camera, origin, centre, side) };
        }
        let seen = |axis: usize, upper: bool| match camera.eye() {
            Eye::Point(_) => {
                if upper {
                    origin[axis] >= size[axis]
                } else {
                    origin[axis] <= 0.0
                }
            }
            Eye::Direction(_) => {
                if upper {
                    ahead[axis] < 0.0
                } else {
                    ahead[axis] > 0.0
                }
            }
        };
        // Edges between a face that is seen and one that is not.
        let sides = (0..12).filter_map(|edge| {
            let (axis, upper) = (edge / 4, [edge & 1 == 1, edge & 2 == 2]);
            let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
            if seen(u, upper[0]) == seen(v, upper[1]) {
                return None;
            }
            let mut from = [0.0; 3];
            (from[u], from[v]) = (if upper[0] { size[u] } else { 0.0 }, if upper[1] { size[v] } else { 0.0 });
            let mut along = [0.0; 3];
            along[axis] = size[axis];
            let normal = match camera.eye() {
                Eye::Point(_) => cross(less(from, origin), along),
                Eye::Direction(_) => cross(ahead, along),
            };
            side(from, normal)
        });
        Outline { sides: sides.collect() }
    }

    /// How far within it a point of the image lies; negative outside.
    #[inline]
    fn depth(&self, x: f64, y: f64) -> f64 {
        self.sides.iter().map(|side| distance(side, [x, y])).fold(f64::INFINITY, f64::min)
    }

    /// The part of the area that it covers of the pixel with the upper left corner (x, y).
    #[inline]
    pub fn cover(&self, x: f64, y: f64) -> f64 {
        let mut cut = false;
        for side in &self.sides {
            let (middle, reach) = (distance(side, [x + 0.5, y + 0.5]), 0.5 * (side[0].abs() + side[1].abs()));
            if middle <= -reach {
                return 0.0;
            }
            cut |= middle < reach;
        }
        if !cut {
            return 1.0;
        }
        let corners = [[x, y], [x + 1.0, y], [x + 1.0, y + 1.0], [x, y + 1.0]];
        // What each side leaves of the pixel (Sutherland and Hodgman, *Reentrant polygon clipping*, 1974).
        let mut polygon = corners.to_vec();
        for side in &self.sides {
            let before = std::mem::take(&mut polygon);
            for (at, &p) in before.iter().enumerate() {
                let q = before[(at + 1) % before.len()];
                let (here, there) = (distance(side, p), distance(side, q));
                if here >= 0.0 {
                    polygon.push(p);
                }
                if (here >= 0.0) != (there >= 0.0) {
                    let part = here / (here - there);
                    polygon.push(std::array::from_fn(|a| p[a] + part * (q[a] - p[a])));
                }
            }
        }
        let twice: f64 = (0..polygon.len())
            .map(|at| {
                let [p, q] = [polygon[at], polygon[(at + 1) % polygon.len()]].map(|p| [p[0] - x, p[1] - y]);
                p[0] * q[1] - q[0] * p[1]
            })
            .sum();
        (0.5 * twice).clamp(0.0, 1.0)
    }

    /// Rays per axis of a pixel that it covers in part, `least` at least: more the less of it, so that a box smaller than the
    /// pixel is met by as many rays as a large one, and then as many as leave a ray on both of its sides.
    pub fn rays(&self, (x, y): (f64, f64), area: f64, least: usize) -> usize {
        let few = (2.0 * RAYS as f64 / area).sqrt().clamp(RAYS as f64, FINEST as f64).ceil() as usize;
        let least = least.max(few);
        if area.min(1.0 - area) < SLIVER {
            return least;
        }
        let parted = |&n: &usize| {
            let stride = stride(n);
            let within = |at: usize| {
                let (u, v) = point(n, stride, at);
                self.depth(x + u, y + v) >= 0.0
            };
            let first = within(0);
            (1..n * n).any(|at| within(at) != first)
        };
        (least..=MOST).find(parted).unwrap_or(least)
    }

    /// Weights of the rays of a pixel that it covers in part, `n` per axis. Rays within it stand for the part that it
    /// covers, the others for the rest. What they need more or less than equal weights is given to those next to the line,
    /// for as little is seen there where the medium thins out, and as much where it ends at once.
    pub fn weights(&self, (x, y): (f64, f64), area: f64, n: usize) -> Vec<f32> {
        let (stride, count) = (stride(n), n * n);
        let depth = |at: usize| {
            let (u, v) = point(n, stride, at);
            self.depth(x + u, y + v)
        };
        let depths: Vec<f64> = (0..count).map(depth).collect();
        let within = depths.iter().filter(|&&d| d >= 0.0).count();
        let equal = 1.0 / count as f64;
        if within == 0 || within == count {
            return vec![equal as f32; count];
        }
        let change = area - within as f64 * equal;
        // The nearest ones of those within, as many as cross a pixel.
        let mut near: Vec<f64> = depths.iter().copied().filter(|&d| d >= 0.0).collect();
        near.sort_by(f64::total_cmp);
        let rim = near[n.min(within) - 1];
        let rims = near.iter().filter(|&&d| d <= rim).count();
        let weight = |depth: f64| match depth {
            d if d < 0.0 => equal - change / (count - within) as f64,
            d if d <= rim => equal + change / rims as f64,
            _ => equal,
        };
        depths.into_iter().map(|d| weight(d) as f32).collect()
    }
}

/// How far inwards from a side a point lies.
#[inline]
fn distance(side: &[f64; 3], p: [f64; 2]) -> f64 {
    side[0] * p[0] + side[1] * p[1] + side[2]
}

/// The sides of a ball's outline: those of a regular polygon of its area.
fn ball(
    camera: &Camera,
    origin: World,
    centre: World,
    side: impl Fn(World, World) -> Option<[f64; 3]>,
) -> Vec<[f64; 3]> {
    let part = PI / TANGENTS as f64;
    let radius = centre[0] * (part / part.tan()).sqrt();
    let to = less(centre, origin);
    let distance = dot(to, to).sqrt();
    let (axis, sine) = match camera.eye() {
        Eye::Point(_) if distance <= radius => return Vec::new(),
        Eye::Point(_) => (unit(to), radius / distance),
        Eye::Direction(_) => (camera.axes()[0], 0.0),
    };
    let cosine = (1.0 - sine * sine).sqrt();
    let least = (0..3).min_by(|&a, &b| axis[a].abs().total_cmp(&axis[b].abs())).unwrap_or(0);
    let u = unit(cross(axis, std::array::from_fn(|a| f64::from(u8::from(a == least)))));
    let v = cross(axis, u);
    let tangent = |i: usize| {
        let (s, c) = (TAU * i as f64 / TANGENTS as f64).sin_cos();
        let outwards: World = std::array::from_fn(|a| c * u[a] + s * v[a]);
        let normal: World = std::array::from_fn(|a| sine * axis[a] - cosine * outwards[a]);
        side(std::array::from_fn(|a| centre[a] - radius * normal[a]), normal)
    };
    (0..TANGENTS).filter_map(tangent).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::Phase;
    use crate::scene::{Albedo, Medium, Spectrum, ViewRay, Volume};

    /// The largest difference between what is covered and the part of a fine grid's rays that meet the medium.
    fn worst(n: [usize; 3], ball: bool, camera: &Camera) -> f64 {
        let density = vec![1.0; n.iter().product()];
        let volume = Volume::new(&density, n, [1.0; 3], [3.0, -2.0, 5.0], false).expect("valid");
        let volume = if ball { volume.ball().expect("a cube") } else { volume };
        let grey = Spectrum::new(&[0.5], "value").expect("valid");
        let medium = Medium::new(volume, grey, Albedo::Constant(grey), Phase::Isotropic).expect("valid");
        let scene = Scene::new(medium, Vec::new(), *camera);
        let outline = Outline::new(&scene, camera);
        const FINE: usize = 64;
        let [width, height] = camera.resolution.map(|m| m as u32);
        let pixels = (0..width * height).map(|at| (f64::from(at % width), f64::from(at / width)));
        let difference = |(x, y): (f64, f64)| {
            let place = |i: usize| (i as f64 + 0.5) / FINE as f64;
            let met = (0..FINE * FINE)
                .filter(|at| ViewRay::new(&scene, camera, x + place(at % FINE), y + place(at / FINE)).is_some())
                .count();
            (outline.cover(x, y) - met as f64 / (FINE * FINE) as f64).abs()
        };
        pixels.map(difference).fold(0.0, f64::max)
    }

    #[test]
    fn an_outline_covers_what_rays_meet() {
        let up = [0.1, 0.2, 1.0];
        let towards = [4.6, 0.2, 6.0];
        let perspective = |eye, fov| Camera::perspective(eye, towards, up, fov, [7, 6]).expect("valid");
        let cameras = [
            perspective([12.0, -9.0, 11.0], 35.0),
            perspective([4.5, 0.4, 19.0], 30.0),
            // Close, with corners behind the eye; on a face; within.
            perspective([2.8, 0.5, 6.3], 150.0),
            perspective([3.0, 0.5, 6.3], 100.0),
            perspective([4.0, 0.5, 6.3], 100.0),
            Camera::orthographic([12.0, -9.0, 11.0], towards, up, 7.0, [7, 6]).expect("valid"),
            Camera::orthographic([4.5, 0.5, 20.0], [4.5, 0.5, 6.0], up, 5.0, [7, 6]).expect("valid"),
        ];
        for (at, camera) in cameras.iter().enumerate() {
            let difference = worst([3, 5, 2], false, camera);
            assert!(difference < 0.02, "{at}: {difference}");
            assert!(worst([1; 3], true, camera) < 0.02, "{at}, ball");
        }
    }

    #[test]
    fn points_are_even_on_both_axes() {
        for n in [1, 2, 3, 4, 5, 6, 8, 16, 17, 32] {
            let points: Vec<(f64, f64)> = (0..n * n).map(|at| point(n, stride(n), at)).collect();
            let steps = |value: fn(&(f64, f64)) -> f64| {
                let mut steps: Vec<i64> =
                    points.iter().map(|p| (value(p) * (n * n) as f64 - 0.5).round() as i64).collect();
                steps.sort_unstable();
                steps
            };
            assert!([steps(|p| p.0), steps(|p| p.1)].iter().all(|s| s.iter().copied().eq(0..(n * n) as i64)), "{n}");
            let covariance = points.iter().map(|p| (p.0 - 0.5) * (p.1 - 0.5)).sum::<f64>();
            assert!(covariance.abs() < 1e-9, "{n}");
            let cell =
                |at: usize, p: &(f64, f64)| (p.0 * n as f64) as usize == at % n && (p.1 * n as f64) as usize == at / n;
            assert!(points.iter().enumerate().all(|(at, p)| cell(at, p)), "{n}");
        }
    }

    #[test]
    fn weights_sum_to_the_part_that_is_covered() {
        // Half planes x + 0.3 y < c. A sliver that none of the rays meets counts as nothing.
        for c in [0.15, 0.3, 0.62, 1.2] {
            let scale = 1.0 / 1.0f64.hypot(0.3);
            let outline = Outline { sides: vec![[-scale, -0.3 * scale, c * scale]] };
            let area = outline.cover(0.0, 0.0);
            let weights = outline.weights((0.0, 0.0), area, 8);
            assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
            let own = |at: usize| {
                let (x, y) = point(8, stride(8), at);
                if x + 0.3 * y < c { f64::from(weights[at]) } else { 0.0 }
            };
            let within = (0..64).map(own).sum::<f64>();
            assert!((within - area).abs() < 1e-5, "{c}: {within} of {area}");
            assert!(weights.iter().all(|&w| w > 0.0));
        }
    }
}
