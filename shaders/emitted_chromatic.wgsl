// What is emitted along a flight on which the weights change: taken at a random point of it.
fn emitted(w: Weights, f: ptr<function, Flight>, p: vec3<f32>, v: vec3<f32>, length: f32) -> Spectrum {
    let t = length * unit(next_words(f).x);
    let here = survived(w, column(p, v, t, FAR));
    return unbiased(here) * length * emissions_at(along(p, v, t));
}
