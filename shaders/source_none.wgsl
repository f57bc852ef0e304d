// No photon found anything.

// Four values of J at a point.
fn source_at(p: vec3<f32>) -> vec4<f32> {
    return vec4(0.0);
}
