// Real spherical harmonics Y_lm of a direction (x, y, z), orthonormal over the sphere, l = 0 ..= order, m = -l ..= l,
// at the index l (l + 1) + m. With theta from +z, phi from +x, and no Condon-Shortley sign (Y_11 = sqrt(3 / (4 pi)) x):
//
// Y_lm = q_lm(z) * Re (x + i y)^m,  m >= 0       (x + i y)^m = sin^m theta (cos m phi + i sin m phi)
// Y_lm = q_l|m|(z) * Im (x + i y)^|m|,  m < 0    q_lm = a_lm z q_(l-1)m - b_lm q_(l-2)m
//
// (Sloan, Efficient spherical harmonic evaluation, JCGT 2(2), 2013).

// The largest order that is known here.
const MAX_ORDER = 8u;

// Tables are private variables, for naga copies a constant one at each look into it.

// q_mm^2 = (2 - delta_m0) / (4 pi) * (3 / 2) (5 / 4) ... ((2m + 1) / (2m)).
var<private> FIRST: array<f32, 9> = array<f32, 9>(
    0.2820948, 0.48860252, 0.54627424, 0.5900436, 0.6258357,
    0.6563821, 0.6831841, 0.70716274, 0.72892666,
);

// (a_lm, b_lm), l = m + 1 ..= MAX_ORDER, for each m in turn: a_lm^2 = (4 l^2 - 1) / (l^2 - m^2) and
// b_lm = a_lm / a_(l-1)m.
var<private> STEP: array<vec2<f32>, 36> = array<vec2<f32>, 36>(
    vec2(1.7320508, 0.0), vec2(1.9364917, 1.118034), vec2(1.9720266, 1.0183501), vec2(1.9843135, 1.0062306),
    vec2(1.9899749, 1.002853), vec2(1.9930434, 1.001542), vec2(1.9948914, 1.0009272), vec2(1.9960899, 1.0006008),
    vec2(2.236068, 0.0), vec2(2.09165, 0.9354144), vec2(2.04939, 0.9797959), vec2(2.0310097, 0.9910312),
    vec2(2.021315, 0.9952267), vec2(2.0155644, 0.9971551), vec2(2.0118694, 0.9981668),
    vec2(2.6457512, 0.0), vec2(2.291288, 0.8660254), vec2(2.1712406, 0.9476071), vec2(2.113942, 0.9736101),
    vec2(2.081666, 0.9847319), vec2(2.0615528, 0.9903379),
    vec2(3.0, 0.0), vec2(2.4874685, 0.8291562), vec2(2.3013682, 0.9251849), vec2(2.20794, 0.9594032),
    vec2(2.1532216, 0.9752174),
    vec2(3.3166249, 0.0), vec2(2.6739483, 0.8062258), vec2(2.4308622, 0.90909094), vec2(2.304886, 0.9481764),
    vec2(3.6055512, 0.0), vec2(2.8504386, 0.7905694), vec2(2.5570416, 0.8970695),
    vec2(3.8729835, 0.0), vec2(3.0178044, 0.7791937),
    vec2(4.1231055, 0.0),
);

// A place in the walk through the harmonics: from l = |m| up to the order, for each |m| in turn.
struct Harmonic {
    l: u32,
    m: u32,
    // q_lm and q_(l-1)m.
    q: f32,
    before: f32,
    // (x + i y)^m.
    power: vec2<f32>,
}

// The walk's start, at Y_00.
fn first_harmonic() -> Harmonic {
    return Harmonic(0u, 0u, FIRST[0], 0.0, vec2(1.0, 0.0));
}

// The walk's next place; it is over when m exceeds `order`, after (order + 1) (order + 2) / 2 of them.
fn next_harmonic(h: Harmonic, d: vec3<f32>, order: u32) -> Harmonic {
    if h.l < order {
        // As many steps come before those of m as m columns hold.
        let step = STEP[h.m * (2u * MAX_ORDER + 1u - h.m) / 2u + h.l - h.m];
        return Harmonic(h.l + 1u, h.m, step.x * d.z * h.q - step.y * h.before, h.q, h.power);
    }
    let m = h.m + 1u;
    let power = vec2(d.x * h.power.x - d.y * h.power.y, d.x * h.power.y + d.y * h.power.x);
    return Harmonic(m, m, FIRST[min(m, MAX_ORDER)], 0.0, power);
}

// (Y_l(-m), Y_lm) at a place; at m = 0, where both are one harmonic, it is the second.
fn harmonic_pair(h: Harmonic) -> vec2<f32> {
    return h.q * h.power.yx;
}

// (index of Y_l(-m), index of Y_lm) at a place: l (l + 1) -+ m.
fn harmonic_index(h: Harmonic) -> vec2<u32> {
    let middle = h.l * (h.l + 1u);
    return vec2(middle - h.m, middle + h.m);
}

// Writes all Y_lm(d) of l <= order <= MAX_ORDER to the first (order + 1)^2 entries of `out`; d must be of unit length.
fn evaluate(d: vec3<f32>, order: u32, out: ptr<function, array<f32, 81>>) {
    for (var h = first_harmonic(); h.m <= order; h = next_harmonic(h, d, order)) {
        let at = harmonic_index(h);
        let y = harmonic_pair(h);
        (*out)[at.x] = y.x;
        (*out)[at.y] = y.y;
    }
}
