// J of the orders that photons found.

@group(0) @binding(26) var source: texture_3d<f32>;

// Four values of J at a point.
fn source_at(p: vec3<f32>) -> vec4<f32> {
    return interpolate(source, p);
}
