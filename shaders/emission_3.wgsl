// The source term of a medium that emits, by channel.

// The source term of a texel of 1, by plane.
@group(0) @binding(39) var<uniform> emission_texel: vec4<f32>;
@group(0) @binding(36) var emission_0: texture_3d<f32>;
@group(0) @binding(37) var emission_1: texture_3d<f32>;
@group(0) @binding(38) var emission_2: texture_3d<f32>;

// The source term of a channel at a point.
fn emission_at(c: u32, p: vec3<f32>) -> f32 {
    switch c {
        case 0u: {
            return emission_texel.x * value_at(emission_0, p);
        }
        case 1u: {
            return emission_texel.y * value_at(emission_1, p);
        }
        default: {
            return emission_texel.z * value_at(emission_2, p);
        }
    }
}

// The integral of a channel's source term along p + t v, t from 0 to end.
fn emission_column(c: u32, p: vec3<f32>, v: vec3<f32>, end: f32) -> f32 {
    switch c {
        case 0u: {
            return emission_texel.x * integral(emission_0, p, v, end, FAR);
        }
        case 1u: {
            return emission_texel.y * integral(emission_1, p, v, end, FAR);
        }
        default: {
            return emission_texel.z * integral(emission_2, p, v, end, FAR);
        }
    }
}

// The source term along u + s w within a cell, as the coefficients of a cubic in s.
fn emission_cubic(cell: vec3<i32>, u: vec3<f32>, w: vec3<f32>) -> array<Spectrum, 4> {
    let r = emission_texel.x * cubic(emission_0, cell, u, w);
    let g = emission_texel.y * cubic(emission_1, cell, u, w);
    let b = emission_texel.z * cubic(emission_2, cell, u, w);
    return array<Spectrum, 4>(vec3(r.x, g.x, b.x), vec3(r.y, g.y, b.y), vec3(r.z, g.z, b.z), vec3(r.w, g.w, b.w));
}
