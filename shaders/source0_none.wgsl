// Order 1 is that of the lights.

// The part of J that belongs to order 1, at a point.
fn source0_at(p: vec3<f32>) -> Spectrum {
    return Spectrum(0.0);
}
