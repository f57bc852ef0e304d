// Integers of 64 bits as two words, the lower first.

// The product of two words, by halves of 16 bits.
fn mul_wide(a: u32, b: u32) -> vec2<u32> {
    let a0 = a & 0xffffu;
    let a1 = a >> 16u;
    let b0 = b & 0xffffu;
    let b1 = b >> 16u;
    // Neither sum overflows: (2^16 - 1)^2 + 2^16 - 1 < 2^32.
    let upper = a1 * b0 + ((a0 * b0) >> 16u);
    let lower = a0 * b1 + (upper & 0xffffu);
    return vec2(a * b, a1 * b1 + (upper >> 16u) + (lower >> 16u));
}

// The upper word of the product of two words.
fn mul_hi(a: u32, b: u32) -> u32 {
    return mul_wide(a, b).y;
}

// a + b, modulo 2^64.
fn add64(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    let low = a.x + b.x;
    return vec2(low, a.y + b.y + u32(low < a.x));
}

// a - b, modulo 2^64.
fn sub64(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    return vec2(a.x - b.x, a.y - b.y - u32(a.x < b.x));
}

// a < b.
fn less64(a: vec2<u32>, b: vec2<u32>) -> bool {
    return a.y < b.y || (a.y == b.y && a.x < b.x);
}

// a * b, modulo 2^64.
fn times64(a: u32, b: vec2<u32>) -> vec2<u32> {
    let low = mul_wide(a, b.x);
    return vec2(low.x, low.y + a * b.y);
}

// (word * b) / 2^32, rounded down: a uniform number below b from a uniform word.
fn mul_high64(word: u32, b: vec2<u32>) -> vec2<u32> {
    return add64(mul_wide(word, b.y), vec2(mul_hi(word, b.x), 0u));
}

// -a, modulo 2^64.
fn negate64(a: vec2<u32>) -> vec2<u32> {
    return add64(~a, vec2(1u, 0u));
}

// a * 2^s, modulo 2^64.
fn shift64(a: vec2<u32>, s: u32) -> vec2<u32> {
    if s >= 32u {
        return vec2(0u, a.x << (s - 32u));
    }
    return vec2(a.x << s, (a.y << s) | select(0u, a.x >> (32u - s), s > 0u));
}

// x as a whole number, |x| < 2^63: rounded away from zero with the chance of its fraction, where that is above xi, uniform
// within (0, 1]. Neither is changed before they are compared, so that the mean is right, however small x.
fn wide_rounded(x: f32, xi: f32) -> vec2<u32> {
    let size = abs(x);
    let whole = floor(size);
    let high = floor(whole * (1.0 / 4294967296.0));
    let low = u32(whole - high * 4294967296.0);
    let units = add64(vec2(low, u32(high)), vec2(u32(xi < size - whole), 0u));
    if x < 0.0 {
        return negate64(units);
    }
    return units;
}

// A number as a float.
fn float64(a: vec2<u32>) -> f32 {
    return f32(a.y) * 4294967296.0 + f32(a.x);
}

// The 32 bits of a / b behind the point, for a < b: right to 2^-31.
fn fraction64(a: vec2<u32>, b: vec2<u32>) -> u32 {
    let s = select(countLeadingZeros(b.y), 32u + countLeadingZeros(b.x), b.y == 0u);
    let whole = shift64(a, s);
    let by = shift64(b, s).y;
    let guess = u32(min(f32(whole.y) / f32(by), 0.99999994) * 4294967296.0);
    // What the guess leaves is put right once.
    let rest = sub64(whole, mul_wide(guess, by));
    let more = (f32(bitcast<i32>(rest.y)) * 4294967296.0 + f32(rest.x)) / f32(by);
    if more < 0.0 {
        return guess - min(u32(-more), guess);
    }
    return guess + min(u32(more), 0xffffffffu - guess);
}
