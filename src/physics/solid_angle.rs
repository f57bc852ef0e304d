//! Solid angles of rectangles and boxes, and points on a rectangle that are even in solid angle.

use std::f64::consts::PI;

/// The solid angle of the rectangle [x0, x1] x [y0, y1] in the plane at distance `z` > 0 from the eye at the origin.
pub fn rectangle_solid_angle(x0: f64, x1: f64, y0: f64, y1: f64, z: f64) -> f64 {
    let corner = |x: f64, y: f64| (x * y / (z * (x * x + y * y + z * z).sqrt())).atan();
    corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0)
}

/// The solid angle of the box [0, size] seen from `eye`: 4 pi from inside, 2 pi on a face. It is that of the faces through
/// which rays from the eye leave the box.
pub fn box_solid_angle(eye: [f64; 3], size: [f64; 3]) -> f64 {
    let mut total = 0.0;
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for z in [eye[axis], size[axis] - eye[axis]] {
            if z > 0.0 {
                total += rectangle_solid_angle(-eye[u], size[u] - eye[u], -eye[v], size[v] - eye[v], z);
            }
        }
    }
    total
}

/// A map of the unit square onto a rectangle that preserves solid angle (Ureña, Fajardo, King, *An area-preserving
/// parametrization for spherical rectangles*, EGSR 2013). The eye is at the origin, the rectangle at the distance `z` > 0.
#[derive(Debug, Clone, Copy)]
pub struct SphericalRectangle {
    x: [f64; 2],
    y: [f64; 2],
    z: f64,
    b: [f64; 2],
    first: f64,
    solid_angle: f64,
}

impl SphericalRectangle {
    /// That of the rectangle [x0, x1] x [y0, y1].
    pub fn new(x: [f64; 2], y: [f64; 2], z: f64) -> Self {
        // Normals of the planes through the eye and a side: (0, -z, -y0), (z, 0, x1), (0, z, y1), (-z, 0, -x0), made units.
        let (below, right) = (-y[0] / z.hypot(y[0]), x[1] / z.hypot(x[1]));
        let (above, left) = (y[1] / z.hypot(y[1]), -x[0] / z.hypot(x[0]));
        // Neighbouring normals have their third component alone in common.
        let angle = |a: f64, b: f64| (-a * b).clamp(-1.0, 1.0).acos();
        let first = 2.0 * PI - angle(above, left) - angle(left, below);
        let solid_angle = angle(below, right) + angle(right, above) - first;
        SphericalRectangle { x, y, z, b: [below, above], first, solid_angle }
    }

    /// The point (x, y) of the rectangle that a point of the unit square is mapped to.
    pub fn at(&self, u: f64, v: f64) -> [f64; 2] {
        let angle = u * self.solid_angle + self.first;
        let f = (angle.cos() * self.b[0] - self.b[1]) / angle.sin();
        let square = f * f + self.b[0] * self.b[0];
        let x = (self.z / (square - 1.0).max(1e-300).sqrt()).copysign(f).clamp(self.x[0], self.x[1]);
        let d = x.hypot(self.z);
        let [low, high] = self.y.map(|y| y / d.hypot(y));
        let sine = low + v * (high - low);
        let y = sine * d / ((1.0 - sine) * (1.0 + sine)).max(1e-300).sqrt();
        [x, y.clamp(self.y[0], self.y[1])]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solid_angle_of_a_cube_face_seen_from_its_centre_is_a_sixth_of_the_sphere() {
        let face = rectangle_solid_angle(-1.0, 1.0, -1.0, 1.0, 1.0);
        assert!((face - 4.0 * PI / 6.0).abs() < 1e-14);
    }

    #[test]
    fn solid_angle_far_away_is_projected_area_over_distance_squared() {
        let d = 1e4;
        let eye = [d, d * 0.5, -d * 0.25];
        let r = (eye.iter().map(|c| c * c).sum::<f64>()).sqrt();
        // Sides x: 1, y: 2, z: 3: the area normal to x is 2 * 3, to y 1 * 3, to z 1 * 2.
        let area = (2.0 * 3.0) * eye[0] / r + (1.0 * 3.0) * eye[1] / r + (1.0 * 2.0) * -eye[2] / r;
        let omega = box_solid_angle(eye, [1.0, 2.0, 3.0]);
        assert!((omega * r * r / area - 1.0).abs() < 1e-3);
    }

    #[test]
    fn solid_angle_on_a_face_an_edge_a_corner_is_a_half_a_quarter_an_eighth_of_the_sphere() {
        let size = [1.0, 2.0, 3.0];
        for (eye, part) in [
            ([0.3, 0.7, 1.1], 1.0),
            ([0.0, 0.7, 1.1], 0.5),
            ([0.3, 2.0, 1.1], 0.5),
            ([1.0, 2.0, 1.1], 0.25),
            ([1.0, 0.0, 3.0], 0.125),
        ] {
            for hair in [0.0, 1e-13] {
                // A hair inside or outside it is what it is on the face, from outside.
                let eye: [f64; 3] = std::array::from_fn(|a| if eye[a] == 0.0 { -hair } else { eye[a] });
                let found = box_solid_angle(eye, size) / (4.0 * PI);
                assert!((found - part).abs() < 1e-12, "{eye:?}: {found}");
            }
        }
    }

    #[test]
    fn points_on_a_rectangle_are_even_in_solid_angle() {
        for (x, y, z) in
            [([-1.0, 2.0], [0.5, 3.0], 0.7), ([0.0, 1.0], [0.0, 2.0], 5.0), ([-3.0, 1.0], [-1e-3, 2.0], 1e-9)]
        {
            let whole = rectangle_solid_angle(x[0], x[1], y[0], y[1], z);
            let map = SphericalRectangle::new(x, y, z);
            assert!((map.solid_angle - whole).abs() < 1e-9 * whole.max(1e-3));
            for (u, v) in [(0.2, 0.4), (0.5, 0.5), (0.9, 0.1), (0.37, 0.99)] {
                // All that is left of the line that u is mapped to, and on it all that is below v.
                let [at, _] = map.at(u, v);
                let left = rectangle_solid_angle(x[0], at, y[0], y[1], z);
                assert!((left / whole - u).abs() < 1e-6, "{x:?} {y:?} {z}: {u} {}", left / whole);
                let strip = |high: f64| {
                    let step = 1e-4 * z.max(x[1] - x[0]).min(z);
                    rectangle_solid_angle(at - step, at + step, y[0], high, z)
                };
                let [_, top] = map.at(u, v);
                assert!((strip(top) / strip(y[1]) - v).abs() < 1e-4, "{x:?} {y:?} {z}: {v}");
            }
        }
    }
}
