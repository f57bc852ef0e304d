// The same density in the whole box.

// The density at a point.
fn density_at(p: vec3<f32>) -> f32 {
    return scene.constant;
}

// The same.
fn density_read(p: vec3<f32>, word: u32) -> f32 {
    return scene.constant;
}

// The density along u + s w within a cell, as the coefficients of a cubic in s.
fn density_cubic(cell: vec3<i32>, u: vec3<f32>, w: vec3<f32>) -> vec4<f32> {
    return vec4(scene.constant, 0.0, 0.0, 0.0);
}

// The column density along p + t v, t from 0 to end.
fn column(p: vec3<f32>, v: vec3<f32>, end: f32, most: f32) -> f32 {
    return scene.constant * min(end, leave(p, v).t);
}
