// The same albedo everywhere.

// The albedo at a point.
fn albedo_at(p: vec3<f32>) -> Spectrum {
    return spectrum(scene.albedo);
}

// The same.
fn albedo_read(p: vec3<f32>, word: u32) -> Spectrum {
    return spectrum(scene.albedo);
}
