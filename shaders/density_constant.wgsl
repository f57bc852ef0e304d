// The same density in the whole box.

// The density at a point.
fn density_at(p: vec3<f32>) -> f32 {
    return scene.constant;
}

// The same.
fn density_read(p: vec3<f32>, word: u32) -> f32 {
    return scene.constant;
}

// The same.
fn density_maximum(cell: vec3<i32>) -> f32 {
    return scene.constant;
}

// The column density along p + t v, t from 0 to end.
fn column(p: vec3<f32>, v: vec3<f32>, end: f32, most: f32) -> f32 {
    return scene.constant * min(end, leave(p, v).t);
}
