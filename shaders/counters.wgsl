// Where the energy of photons went, in copies so that few invocations meet in one; and how many are done.

@group(0) @binding(20) var<storage, read_write> counters: array<atomic<u32>>;

// Copies of all counters, and words of each.
const COPIES = 64u;
const WORDS = 72u;
// The words of a copy: two for each share and channel, then these.
const COLLISIONS = 66u;
const FINISHED = 68u;

// Shares of the energy; those that leave through the faces -x +x -y +y -z +z follow in turn.
const MISSED = 0u;
const UNSCATTERED = 1u;
const ABSORBED = 2u;
const TRUNCATED = 3u;
const LOST = 4u;
const ESCAPED = 5u;

// A weight of 1 is 2^36 units, in two words.
const SIXTEEN = 16.0;

// Adds to a counter of two words.
fn count_wide(at: u32, units: vec2<u32>) {
    let before = atomicAdd(&counters[at], units.x);
    let carry = units.y + u32(before + units.x < before);
    if carry != 0u {
        atomicAdd(&counters[at + 1u], carry);
    }
}

// Adds a weight to a share.
fn add_share(copy: u32, share: u32, weight: Spectrum) {
    for (var c = 0u; c < CHANNELS; c++) {
        count_wide(copy * WORDS + 2u * (3u * share + c), wide_cut(channel(weight, c) * SIXTEEN));
    }
}

// Adds a weight to sums of two words.
fn add_weight(sums: ptr<function, array<vec2<u32>, CHANNELS>>, weight: Spectrum) {
    for (var c = 0u; c < CHANNELS; c++) {
        (*sums)[c] = add64((*sums)[c], wide_cut(channel(weight, c) * SIXTEEN));
    }
}
