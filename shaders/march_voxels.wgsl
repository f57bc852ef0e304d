// The texel of a voxel of the density.
fn march_texel(cell: vec3<i32>) -> f32 {
    return texel(density, cell);
}
