// The source term of a medium that emits, the same in all channels.

// The source term of a texel of 1, by plane.
@group(0) @binding(39) var<uniform> emission_texel: vec4<f32>;
@group(0) @binding(36) var emission_0: texture_3d<f32>;

// The source term of a channel at a point.
fn emission_at(c: u32, p: vec3<f32>) -> f32 {
    return emission_texel.x * value_at(emission_0, p);
}

// The integral of a channel's source term along p + t v, t from 0 to end.
fn emission_column(c: u32, p: vec3<f32>, v: vec3<f32>, end: f32) -> f32 {
    return emission_texel.x * integral(emission_0, p, v, end, FAR);
}

// The source term along u + s w within a cell, as the coefficients of a cubic in s.
fn emission_cubic(cell: vec3<i32>, u: vec3<f32>, w: vec3<f32>) -> array<Spectrum, 4> {
    let c = emission_texel.x * cubic(emission_0, cell, u, w);
    return array<Spectrum, 4>(Spectrum(c.x), Spectrum(c.y), Spectrum(c.z), Spectrum(c.w));
}
