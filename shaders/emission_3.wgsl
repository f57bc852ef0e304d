// The source term of a medium that emits, by channel.

// The source term of a texel of 1.
override EMISSION_TEXEL_0: f32;
override EMISSION_TEXEL_1: f32;
override EMISSION_TEXEL_2: f32;
@group(0) @binding(36) var emission_0: texture_3d<f32>;
@group(0) @binding(37) var emission_1: texture_3d<f32>;
@group(0) @binding(38) var emission_2: texture_3d<f32>;

// The source term of a channel at a point.
fn emission_at(c: u32, p: vec3<f32>) -> f32 {
    switch c {
        case 0u: {
            return EMISSION_TEXEL_0 * value_at(emission_0, p);
        }
        case 1u: {
            return EMISSION_TEXEL_1 * value_at(emission_1, p);
        }
        default: {
            return EMISSION_TEXEL_2 * value_at(emission_2, p);
        }
    }
}

// The integral of a channel's source term along p + t v, t from 0 to end.
fn emission_column(c: u32, p: vec3<f32>, v: vec3<f32>, end: f32) -> f32 {
    switch c {
        case 0u: {
            return EMISSION_TEXEL_0 * integral(emission_0, p, v, end, FAR);
        }
        case 1u: {
            return EMISSION_TEXEL_1 * integral(emission_1, p, v, end, FAR);
        }
        default: {
            return EMISSION_TEXEL_2 * integral(emission_2, p, v, end, FAR);
        }
    }
}

// The source term along u + s w within a cell, as the coefficients of a cubic in s.
fn emission_cubic(cell: vec3<i32>, u: vec3<f32>, w: vec3<f32>) -> array<Spectrum, 4> {
    let r = EMISSION_TEXEL_0 * cubic(emission_0, cell, u, w);
    let g = EMISSION_TEXEL_1 * cubic(emission_1, cell, u, w);
    let b = EMISSION_TEXEL_2 * cubic(emission_2, cell, u, w);
    return array<Spectrum, 4>(vec3(r.x, g.x, b.x), vec3(r.y, g.y, b.y), vec3(r.z, g.z, b.z), vec3(r.w, g.w, b.w));
}
