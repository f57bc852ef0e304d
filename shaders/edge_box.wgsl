// The medium fills the box.

struct Leave {
    axis: i32,
    t: f32,
}

// Where a line from within the box [0, n] leaves it: the axis of the face, and the parameter.
fn leave(p: vec3<f32>, v: vec3<f32>) -> Leave {
    var out = Leave(0, FAR);
    for (var a = 0; a < 3; a++) {
        if v[a] != 0.0 {
            let edge = select(0.0, f32(scene.n[a]), v[a] > 0.0);
            let t = max((edge - p[a]) / v[a], 0.0);
            if t < out.t {
                out = Leave(a, t);
            }
        }
    }
    return out;
}

// Whether a point is within the box.
fn contains(p: vec3<f32>) -> bool {
    return all(p >= vec3(0.0)) && all(p < vec3<f32>(scene.n));
}

// (entry, exit) parameters of the line p + t v; it misses unless entry < exit.
fn meet(p: vec3<f32>, v: vec3<f32>) -> vec2<f32> {
    return box_range(p, v, vec3<f32>(scene.n));
}
