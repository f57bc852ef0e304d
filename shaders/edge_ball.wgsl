// The medium fills the ball in a cube of one voxel.

struct Leave {
    axis: i32,
    t: f32,
}

// Where a line from within the ball leaves it; there are no faces.
fn leave(p: vec3<f32>, v: vec3<f32>) -> Leave {
    let r = p - 0.5;
    let a = dot(v, v);
    let b = dot(r, v);
    let c = dot(r, r) - 0.25;
    let root = sqrt(max(b * b - a * c, 0.0));
    // The form that does not cancel.
    if b > 0.0 {
        return Leave(0, max(-c / (b + root), 0.0));
    }
    return Leave(0, max((root - b) / a, 0.0));
}

// Whether a point is within the ball.
fn contains(p: vec3<f32>) -> bool {
    let r = p - 0.5;
    return r.x * r.x + r.y * r.y + r.z * r.z < 0.25;
}

// (entry, exit) parameters of the line p + t v; it misses unless entry < exit.
fn meet(p: vec3<f32>, v: vec3<f32>) -> vec2<f32> {
    return ball_range(p, v, 0.5);
}
