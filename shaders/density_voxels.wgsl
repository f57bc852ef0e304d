// A density that differs from voxel to voxel.

@group(0) @binding(1) var density: texture_3d<f32>;

// The density at a point.
fn density_at(p: vec3<f32>) -> f32 {
    return scene.texel * value_at(density, p);
}

// A density whose mean over `word` is that at the point.
fn density_read(p: vec3<f32>, word: u32) -> f32 {
    return scene.texel * one_read(density, p, word);
}

// The density along u + s w within a cell, as the coefficients of a cubic in s.
fn density_cubic(cell: vec3<i32>, u: vec3<f32>, w: vec3<f32>) -> vec4<f32> {
    return scene.texel * cubic(density, cell, u, w);
}

// The column density along p + t v, t from 0 to end, no further than where it exceeds `most`.
fn column(p: vec3<f32>, v: vec3<f32>, end: f32, most: f32) -> f32 {
    return scene.texel * integral(density, p, v, end, most / scene.texel);
}
