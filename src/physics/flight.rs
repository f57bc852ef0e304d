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

#[cfg(test)]
mod tests {
    use super::*;

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
