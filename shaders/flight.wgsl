// Straight lines: where a ray meets a box, and what survives along it.

// The mean transmittance over a step of optical depth tau: (1 - exp(-tau)) / tau, and 1 at 0.
fn mean_transmittance(tau: f32) -> f32 {
    if tau > 1e-3 {
        return -expo_m1(-tau) / tau;
    }
    return 1.0 - tau * (0.5 - tau * (1.0 / 6.0));
}

// (entry, exit) parameters of the line p + t v through the box [0, n]; it misses unless entry < exit. A line in a
// face's plane counts as inside.
fn box_range(p: vec3<f32>, v: vec3<f32>, n: vec3<f32>) -> vec2<f32> {
    let parallel = v == vec3(0.0);
    if any(parallel & ((p < vec3(0.0)) | (p > n))) {
        return vec2(0.0);
    }
    let a = -p / v;
    let b = (n - p) / v;
    let enter = select(min(a, b), vec3(-3.4028235e38), parallel);
    let leave = select(max(a, b), vec3(3.4028235e38), parallel);
    return vec2(max(max(enter.x, enter.y), enter.z), min(min(leave.x, leave.y), leave.z));
}

// (entry, exit) parameters of the line p + t v through the ball of the given radius around (radius, radius, radius); it
// misses unless entry < exit.
fn ball_range(p: vec3<f32>, v: vec3<f32>, radius: f32) -> vec2<f32> {
    let r = p - radius;
    let speed2 = dot(v, v);
    // From the point nearest to the centre, which loses nothing to cancellation.
    let foot = -dot(r, v) / speed2;
    let nearest = r + foot * v;
    let half2 = (radius * radius - dot(nearest, nearest)) / speed2;
    if half2 <= 0.0 {
        return vec2(0.0);
    }
    return vec2(foot - sqrt(half2), foot + sqrt(half2));
}
