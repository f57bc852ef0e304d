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
