// Reads of voxels that all interpolations share.

// The texel of a voxel on the grid.
fn texel(field: texture_3d<f32>, cell: vec3<i32>) -> f32 {
    return textureLoad(field, cell, 0).x;
}

// Up to half a voxel either way along each axis, from ten bits of a word each.
fn jitter(word: u32) -> vec3<f32> {
    let bits = vec3(word, word >> 10u, word >> 20u) & vec3(1023u);
    return vec3<f32>(bits) * (1.0 / 1024.0) - (511.5 / 1024.0);
}

// The voxel of a point, kept on the grid.
fn voxel_of(p: vec3<f32>) -> vec3<i32> {
    return clamp(vec3<i32>(p), vec3(0), scene.n - 1);
}

// The index of a voxel.
fn index_of(cell: vec3<i32>) -> u32 {
    let c = vec3<u32>(cell);
    let n = vec3<u32>(scene.n);
    return (c.z * n.y + c.y) * n.x + c.x;
}
