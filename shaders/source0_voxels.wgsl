// The part of J that belongs to order 1.

@group(0) @binding(27) var source0: texture_3d<f32>;

// It at a point.
fn source0_at(p: vec3<f32>) -> Spectrum {
    return spectrum(interpolate(source0, p).xyz);
}
