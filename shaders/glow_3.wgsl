// The source term of three channels.

@group(0) @binding(35) var glow_0: texture_3d<f32>;
@group(0) @binding(36) var glow_1: texture_3d<f32>;
@group(0) @binding(37) var glow_2: texture_3d<f32>;

// Its integral along p + t v, t from 0 to end.
fn glow_column(p: vec3<f32>, v: vec3<f32>, end: f32) -> Spectrum {
    let red = integral(glow_0, p, v, end, FAR);
    let green = integral(glow_1, p, v, end, FAR);
    let blue = integral(glow_2, p, v, end, FAR);
    return spectrum(job.glow * vec3(red, green, blue));
}

// Its value at a point.
fn glow_at(p: vec3<f32>) -> Spectrum {
    return spectrum(job.glow * vec3(value_at(glow_0, p), value_at(glow_1, p), value_at(glow_2, p)));
}
