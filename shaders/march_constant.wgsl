// The march through a constant density, voxel by voxel.
fn march_texel(cell: vec3<i32>) -> f32 {
    return scene.constant / scene.texel;
}
