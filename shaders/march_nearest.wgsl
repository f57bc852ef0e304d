// The march through voxels of constant density.

// The integral of the density's texels from t0 to t1 of a line within a part.
fn march_piece(cell: vec3<i32>, p: vec3<f32>, v: vec3<f32>, t0: f32, t1: f32) -> f32 {
    return march_texel(cell) * (t1 - t0);
}

// Where within [t0, t1] that integral from t0 reaches `goal`.
fn march_invert(cell: vec3<i32>, p: vec3<f32>, v: vec3<f32>, t0: f32, t1: f32, goal: f32) -> f32 {
    return min(t0 + goal / march_texel(cell), t1);
}
