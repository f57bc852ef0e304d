// Counter-based random numbers: a pure function of (seed, photon, draw). Philox4x32 with 7 rounds (Salmon, Moraes,
// Dror, Shaw, Parallel random numbers: as easy as 1, 2, 3, SC 2011).

const MULTIPLIER = vec2<u32>(0xD2511F53u, 0xCD9E8D57u);
const WEYL = vec2<u32>(0x9E3779B9u, 0xBB67AE85u);
const LN_2: f32 = 0.6931472;

// One round of Philox4x32 on the counter c.
fn philox_round(c: vec4<u32>, key: vec2<u32>) -> vec4<u32> {
    let a = mul_wide(MULTIPLIER.x, c.x);
    let b = mul_wide(MULTIPLIER.y, c.z);
    return vec4(b.y ^ c.y ^ key.x, b.x, a.y ^ c.w ^ key.y, a.x);
}

// Four random words: block `block` of the photon `index` under `seed`. Without a loop, for iterations are counted.
fn words(seed: vec2<u32>, index: vec2<u32>, block: u32, purpose: u32) -> vec4<u32> {
    var key = seed;
    var c = philox_round(vec4(index, block, purpose), key);
    key += WEYL;
    c = philox_round(c, key);
    key += WEYL;
    c = philox_round(c, key);
    key += WEYL;
    c = philox_round(c, key);
    key += WEYL;
    c = philox_round(c, key);
    key += WEYL;
    c = philox_round(c, key);
    key += WEYL;
    return philox_round(c, key);
}

// The random numbers of one photon: block after block of four words.
struct Draws {
    key: vec2<u32>,
    index: vec2<u32>,
    block: u32,
    purpose: u32,
}

// The next four words.
fn next4(draws: ptr<function, Draws>) -> vec4<u32> {
    let four = words((*draws).key, (*draws).index, (*draws).block, (*draws).purpose);
    (*draws).block += 1u;
    return four;
}

// A word as a uniform number in (0, 1]: relative precision down to 2^-33, never 0.
fn unit(word: u32) -> f32 {
    return (f32(word) + 0.5) * (1.0 / 4294967296.0);
}

// What rounds a number by chance, within (0, 1]: 31 bits, mixed, for what else reads the word reads its upper bits first.
fn rounding(word: u32) -> f32 {
    return (f32((word * 2654435769u) >> 1u) + 0.5) * (1.0 / 2147483648.0);
}

// An exponential free flight in mean free paths, without the end that 32 bits would set at 22.9: the zero word stands
// for all that lies beyond 32 ln 2 and draws again (the exponential has no memory).
fn exponential(word: u32, draws: ptr<function, Draws>) -> f32 {
    if word != 0u {
        return -ln(unit(word));
    }
    return 32.0 * LN_2 - ln(unit(next4(draws).x));
}
