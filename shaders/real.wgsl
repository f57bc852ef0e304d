// The functions of f32 on which the physics rests, with the polynomials of Cephes (Moshier, Methods and programs for
// mathematical functions, 1989: logf, expf, sinf). Rounding is asked for by its name, for a compiler that may reorder
// sums would drop the large number that is added and taken away in its stead on the CPU.

// ln 2 = LN_2_HIGH - LN_2_LOW, the first with few bits.
const LN_2_HIGH: f32 = 0.6933594;
const LN_2_LOW: f32 = 2.1219444e-4;
const LOG2_E: f32 = 1.442695;
const FRAC_PI_2: f32 = 1.5707964;

// Natural logarithm of a positive normal number.
fn ln(x: f32) -> f32 {
    // x = 2^exponent * (1 + m) with 1 + m within [sqrt(1/2), sqrt(2)).
    let shifted = bitcast<u32>(x) - 0x3f3504f3u;
    let exponent = f32(bitcast<i32>(shifted) >> 23u);
    return ln_parts(bitcast<f32>((shifted & 0x007fffffu) + 0x3f3504f3u) - 1.0, exponent);
}

// ln(1 + x) for x within [-0.29, 0.41], which keeps its precision near 0.
fn ln_1p(x: f32) -> f32 {
    return ln_parts(x, 0.0);
}

// ln((1 + m) 2^exponent) for 1 + m within [sqrt(1/2), sqrt(2)).
fn ln_parts(m: f32, exponent: f32) -> f32 {
    let z = m * m;
    var y = 7.0376836e-2;
    y = y * m - 1.151461e-1;
    y = y * m + 1.1676999e-1;
    y = y * m - 1.2420141e-1;
    y = y * m + 1.4249323e-1;
    y = y * m - 1.6668058e-1;
    y = y * m + 2.0000715e-1;
    y = y * m - 2.4999994e-1;
    y = y * m + 3.333333e-1;
    y = y * m * z;
    y = y - LN_2_LOW * exponent - 0.5 * z;
    return m + y + LN_2_HIGH * exponent;
}

// (p, 2^n) of exp(x) = (1 + p) 2^n, |p| < 0.42, for x within [-87.3, 88.3] and at its nearer end beyond.
fn exp_parts(x: f32) -> vec2<f32> {
    let inside = min(max(x, -87.3), 88.3);
    let power = round(inside * LOG2_E);
    let r = inside - power * LN_2_HIGH + power * LN_2_LOW;
    var y = 1.9875691e-4;
    y = y * r + 1.3981999e-3;
    y = y * r + 8.333452e-3;
    y = y * r + 4.1665796e-2;
    y = y * r + 1.6666665e-1;
    y = y * r + 5.0e-1;
    let two = bitcast<f32>((bitcast<u32>(i32(power)) << 23u) + 0x3f800000u);
    return vec2(y * (r * r) + r, two);
}

// Exponential; 0 below -87.
fn expo(x: f32) -> f32 {
    let e = exp_parts(x);
    return select((e.x + 1.0) * e.y, 0.0, x < -87.3);
}

// exp(x) - 1, which keeps its precision near 0.
fn expo_m1(x: f32) -> f32 {
    let e = exp_parts(x);
    return select(e.x * e.y + (e.y - 1.0), e.x, e.y == 1.0);
}

// (sine, cosine) of 2 pi x, for |x| < 2^20.
fn sin_cos_turn(x: f32) -> vec2<f32> {
    // Quarter turns, and the rest within an eighth of a turn.
    let quarters = 4.0 * x;
    let nearest = round(quarters);
    let r = (quarters - nearest) * FRAC_PI_2;
    let quadrant = bitcast<u32>(i32(nearest));
    let z = r * r;
    var s = -1.9515296e-4;
    s = s * z + 8.332161e-3;
    s = s * z - 1.6666655e-1;
    s = s * z * r + r;
    var c = 2.4433157e-5;
    c = c * z - 1.3887316e-3;
    c = c * z + 4.1666646e-2;
    c = c * z * z - 0.5 * z + 1.0;
    let magnitudes = select(vec2(s, c), vec2(c, s), (quadrant & 1u) == 1u);
    let signs = (vec2(quadrant, quadrant + 1u) & vec2(2u)) << vec2(30u);
    return bitcast<vec2<f32>>(bitcast<vec2<u32>>(magnitudes) ^ signs);
}

// atan2(y, x) within [-pi, pi] (Moshier 1989: atanf).
fn angle(y: f32, x: f32) -> f32 {
    let short = min(abs(x), abs(y));
    let long = max(abs(x), abs(y));
    // The ratio, or beyond tan(pi / 8) that of the angle less pi / 4.
    let beyond = short > 0.41421357 * long;
    let t = select(short, short - long, beyond) / max(select(long, short + long, beyond), 1.1754944e-38);
    let z = t * t;
    var a = 8.053744e-2;
    a = a * z - 1.3877685e-1;
    a = a * z + 1.9977711e-1;
    a = a * z - 3.3332950e-1;
    a = a * z * t + t;
    a = select(a, a + 0.7853982, beyond);
    a = select(a, 1.5707964 - a, abs(y) > abs(x));
    a = select(a, 3.1415927 - a, bitcast<i32>(x) < 0);
    return bitcast<f32>(bitcast<u32>(a) | (bitcast<u32>(y) & 0x80000000u));
}

// Tangent within [-pi / 2, pi / 2] (Moshier 1989: tanf).
fn tangent(x: f32) -> f32 {
    // Beyond pi / 4 from what is left to pi / 2, which is the sum of two numbers.
    let steep = abs(x) > 0.7853982;
    let rest = select(abs(x), (FRAC_PI_2 - abs(x)) - 4.371139e-8, steep);
    let z = rest * rest;
    var y = 9.385402e-3;
    y = y * z + 3.1199223e-3;
    y = y * z + 2.4430135e-2;
    y = y * z + 5.3411281e-2;
    y = y * z + 1.3338799e-1;
    y = y * z + 3.3333157e-1;
    y = y * z * rest + rest;
    y = select(y, 1.0 / y, steep);
    return select(y, -y, x < 0.0);
}

// The cell [i, i + 1) that holds x, 0 <= x < 2^22; an integer may count to the cell below it (0 does not).
fn cell(x: f32) -> i32 {
    return i32(round(x - 0.5));
}

// The largest integer not above x, |x| < 2^31.
fn floor_i(x: f32) -> i32 {
    return i32(floor(x));
}
