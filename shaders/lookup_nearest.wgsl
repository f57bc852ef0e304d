// Fields that are constant within each voxel.

// The texel at a point.
fn value_at(field: texture_3d<f32>, p: vec3<f32>) -> f32 {
    return texel(field, voxel_of(p));
}

// The same: one read is enough.
fn one_read(field: texture_3d<f32>, p: vec3<f32>, word: u32) -> f32 {
    return value_at(field, p);
}

// The field along u + s w, u and w in a voxel, as the coefficients of a cubic in s.
fn cubic(field: texture_3d<f32>, cell: vec3<i32>, u: vec3<f32>, w: vec3<f32>) -> vec4<f32> {
    return vec4(texel(field, cell), 0.0, 0.0, 0.0);
}

// The integral over the piece from t0 to t1 of a line, within one voxel.
fn piece(field: texture_3d<f32>, cell: vec3<i32>, p: vec3<f32>, v: vec3<f32>, t0: f32, t1: f32) -> f32 {
    return texel(field, cell) * (t1 - t0);
}

// Where within [t0, t1] the integral from t0 reaches `goal`, in a voxel that holds the line between them.
fn invert(field: texture_3d<f32>, cell: vec3<i32>, p: vec3<f32>, v: vec3<f32>, t0: f32, t1: f32, goal: f32) -> f32 {
    return min(t0 + goal / max(texel(field, cell), 1e-30), t1);
}

// The walk over the cells within which the field is one polynomial: the voxels.
fn cells(p: vec3<f32>, v: vec3<f32>) -> Dda {
    return dda(p, v, vec3(0), scene.n);
}
