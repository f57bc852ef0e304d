// The march between voxel centres, by half voxels: each lies in one voxel and in one cell between centres.

// The cell of interpolation that holds half a voxel.
fn between(cell: vec3<i32>) -> vec3<i32> {
    return (cell + 1) / 2 - 1;
}

// The integral of the density's texels from t0 to t1 of a line within a part: Simpson's rule is exact for its cubic.
fn march_piece(cell: vec3<i32>, p: vec3<f32>, v: vec3<f32>, t0: f32, t1: f32) -> f32 {
    let c = between(cell);
    let texels = corners(density, c);
    let length = t1 - t0;
    let sum = corners_at(texels, local(along(p, v, t0), c)) + 4.0 * corners_at(texels, local(along(p, v, t0 + 0.5 * length), c))
        + corners_at(texels, local(along(p, v, t0 + length), c));
    return sum * (length * (1.0 / 6.0));
}

// Where within [t0, t1] that integral from t0 reaches `goal`.
fn march_invert(cell: vec3<i32>, p: vec3<f32>, v: vec3<f32>, t0: f32, t1: f32, goal: f32) -> f32 {
    return invert(density, between(cell), p, v, t0, t1, goal);
}
