//! Straight lines: where a ray meets a box, and what survives along it.

/// The mean transmittance over a step of optical depth `tau`: (1 - exp(-tau)) / tau, and 1 at 0.
#[inline(always)]
pub fn mean_transmittance(tau: f32) -> f32 {
    if tau > 1e-3 { -(-tau).exp_m1() / tau } else { 1.0 - tau * (0.5 - tau * (1.0 / 6.0)) }
}

/// Entry and exit parameters of the line `p + t v` through the box [0, n]: `None` where it misses.
/// A line in a face's plane counts as inside.
#[inline]
pub fn box_range(p: [f64; 3], v: [f64; 3], n: [f64; 3]) -> Option<(f64, f64)> {
    let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
    for axis in 0..3 {
        if v[axis] == 0.0 {
            if p[axis] < 0.0 || p[axis] > n[axis] {
                return None;
            }
        } else {
            let (a, b) = (-p[axis] / v[axis], (n[axis] - p[axis]) / v[axis]);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
    }
    (enter < leave).then_some((enter, leave))
}

/// Entry and exit parameters of the line `p + t v` through the ball of the given radius around (radius, radius, radius).
#[inline]
pub fn ball_range(p: [f64; 3], v: [f64; 3], radius: f64) -> Option<(f64, f64)> {
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let (r, speed2) = (p.map(|c| c - radius), dot(v, v));
    // From the point nearest to the centre, which loses nothing to cancellation.
    let foot = -dot(r, v) / speed2;
    let nearest: [f64; 3] = std::array::from_fn(|a| r[a] + foot * v[a]);
    let half2 = (radius * radius - dot(nearest, nearest)) / speed2;
    (half2 > 0.0).then(|| (foot - half2.sqrt(), foot + half2.sqrt()))
}

/// The solid angle of the rectangle [x0, x1] x [y0, y1] in the plane at distance `z` > 0 from the eye at the origin.
pub fn rectangle_solid_angle(x0: f64, x1: f64, y0: f64, y1: f64, z: f64) -> f64 {
    let corner = |x: f64, y: f64| (x * y / (z * (x * x + y * y + z * z).sqrt())).atan();
    corner(x1, y1) - corner(x0, y1) - corner(x1, y0) + corner(x0, y0)
}

/// The solid angle of the box [0, size] seen from `eye`; 4 pi from inside.
pub fn box_solid_angle(eye: [f64; 3], size: [f64; 3]) -> f64 {
    if (0..3).all(|a| eye[a] > 0.0 && eye[a] < size[a]) {
        return 4.0 * std::f64::consts::PI;
    }
    let mut total = 0.0;
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let z = if eye[axis] < 0.0 { -eye[axis] } else { eye[axis] - size[axis] };
        if z > 0.0 {
            total += rectangle_solid_angle(-eye[u], size[u] - eye[u], -eye[v], size[v] - eye[v], z);
        }
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solid_angle_of_a_cube_face_seen_from_its_centre_is_a_sixth_of_the_sphere() {
        let face = rectangle_solid_angle(-1.0, 1.0, -1.0, 1.0, 1.0);
        assert!((face - 4.0 * std::f64::consts::PI / 6.0).abs() < 1e-14);
    }

    #[test]
    fn solid_angle_far_away_is_projected_area_over_distance_squared() {
        let d = 1e4;
        let eye = [d, d * 0.5, -d * 0.25];
        let r = (eye.iter().map(|c| c * c).sum::<f64>()).sqrt();
        let area = (2.0 * 3.0) * eye[2].abs() / r + (3.0 * 1.0) * eye[0].abs() / r + (2.0 * 1.0) * eye[1].abs() / r;
        // sides x: 1, y: 2, z: 3 -> area normal to x is 2*3, to y 1*3, to z 1*2
        let area_exact = (2.0 * 3.0) * eye[0] / r + (1.0 * 3.0) * eye[1] / r + (1.0 * 2.0) * -eye[2] / r;
        assert!(area > 0.0);
        let omega = box_solid_angle(eye, [1.0, 2.0, 3.0]);
        assert!((omega * r * r / area_exact - 1.0).abs() < 1e-3);
    }

    #[test]
    fn mean_transmittance_is_smooth_and_right() {
        for tau in [0.0f32, 1e-6, 9.9e-4, 1.01e-3, 0.1, 3.0, 80.0] {
            let t = f64::from(tau);
            let exact = if t == 0.0 { 1.0 } else { -(-t).exp_m1() / t };
            assert!((f64::from(mean_transmittance(tau)) - exact).abs() < 2e-7 * exact.max(1e-3), "tau = {tau}");
        }
    }

    #[test]
    fn ball_range_finds_entry_and_exit() {
        let hit = ball_range([-3.0, 1.6, 1.0], [2.0, 0.0, 0.0], 1.0).expect("a hit");
        assert!((hit.0 - 1.6).abs() < 1e-14 && (hit.1 - 2.4).abs() < 1e-14);
        assert_eq!(ball_range([-3.0, 2.1, 1.0], [2.0, 0.0, 0.0], 1.0), None);
    }

    #[test]
    fn box_range_finds_entry_and_exit() {
        let hit = box_range([-1.0, 0.5, 0.5], [2.0, 0.0, 0.0], [1.0; 3]);
        assert_eq!(hit, Some((0.5, 1.0)));
        assert_eq!(box_range([-1.0, 2.5, 0.5], [2.0, 0.0, 0.0], [1.0; 3]), None);
    }
}
