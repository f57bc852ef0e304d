// An albedo that differs from voxel to voxel.

@group(0) @binding(2) var albedo_field: texture_3d<f32>;

// The albedo at a point.
fn albedo_at(p: vec3<f32>) -> Spectrum {
    return Spectrum(scene.albedo_texel * value_at(albedo_field, p));
}

// Absorption at a point of the given density, in multiples of what the densest voxel would absorb if its albedo were 0.
fn relative_absorption(p: vec3<f32>, density: f32) -> f32 {
    return density * scene.per_density * (1.0 - scene.albedo_texel * value_at(albedo_field, p));
}

// An albedo whose mean over `word` is that at the point.
fn albedo_read(p: vec3<f32>, word: u32) -> Spectrum {
    return Spectrum(scene.albedo_texel * one_read(albedo_field, p, word));
}
