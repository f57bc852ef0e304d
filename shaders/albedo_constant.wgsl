// The same albedo everywhere.

// The albedo at a point.
fn albedo_at(p: vec3<f32>) -> Spectrum {
    return spectrum(scene.albedo);
}

// Absorption at a point of the given density, in multiples of the densest voxel's.
fn relative_absorption(p: vec3<f32>, density: f32) -> f32 {
    return density * scene.per_density;
}

// The same albedo, which no read is needed for.
fn albedo_read(p: vec3<f32>, word: u32) -> Spectrum {
    return spectrum(scene.albedo);
}
