// The source term, the same in all channels.

@group(0) @binding(35) var glow_0: texture_3d<f32>;

// Its integral along p + t v, t from 0 to end.
fn glow_column(p: vec3<f32>, v: vec3<f32>, end: f32) -> Spectrum {
    return Spectrum(job.glow.x * integral(glow_0, p, v, end, FAR));
}

// Its value at a point.
fn glow_at(p: vec3<f32>) -> Spectrum {
    return Spectrum(job.glow.x * value_at(glow_0, p));
}
