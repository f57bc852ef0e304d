// Where the column density along a line reaches a given one, in a homogeneous medium.

// The parameter within [0, end].
fn reach(p: vec3<f32>, v: vec3<f32>, end: f32, wanted: f32) -> f32 {
    return min(end * min(max(wanted, 0.0) / max(scene.constant * end, 1e-30), 1.0), end);
}
