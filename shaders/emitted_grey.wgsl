// What is emitted along a flight whose weights do not change.
fn emitted(w: Weights, f: ptr<function, Flight>, p: vec3<f32>, v: vec3<f32>, length: f32) -> Spectrum {
    return unbiased(w) * emission_columns(p, v, length);
}
