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

// A weight of 1 in units.
const ENERGY_UNIT = 68719476736.0;

// Adds to a counter of two words.
fn count_wide(at: u32, units: vec2<u32>) {
    let before = atomicAdd(&counters[at], units.x);
    let carry = units.y + u32(before + units.x < before);
    if carry != 0u {
        atomicAdd(&counters[at + 1u], carry);
    }
}

// Adds a weight to a share; xi rounds.
fn add_share(copy: u32, share: u32, weight: Spectrum, xi: f32) {
    for (var c = 0u; c < CHANNELS; c++) {
        count_wide(copy * WORDS + 2u * (3u * share + c), wide_rounded(channel(weight, c) * ENERGY_UNIT, xi));
    }
}

// What the photons of an invocation did since it began.
struct Toll {
    // Which copy it is told to.
    copy: u32,
    collisions: u32,
    finished: u32,
    // Weights that were absorbed, and lost less won in roulette.
    taken: array<vec2<u32>, CHANNELS>,
    lost: array<vec2<u32>, CHANNELS>,
}

// Adds a weight that was absorbed; xi rounds.
fn add_taken(toll: ptr<function, Toll>, weight: Spectrum, xi: f32) {
    for (var c = 0u; c < CHANNELS; c++) {
        (*toll).taken[c] = add64((*toll).taken[c], wide_rounded(channel(weight, c) * ENERGY_UNIT, xi));
    }
}

// Adds a weight that was lost in roulette; one that was won is negative. xi rounds.
fn add_lost(toll: ptr<function, Toll>, weight: Spectrum, xi: f32) {
    for (var c = 0u; c < CHANNELS; c++) {
        (*toll).lost[c] = add64((*toll).lost[c], wide_rounded(channel(weight, c) * ENERGY_UNIT, xi));
    }
}

// Counts it all.
fn tell(toll: ptr<function, Toll>) {
    let first = (*toll).copy * WORDS;
    for (var c = 0u; c < CHANNELS; c++) {
        count_wide(first + 2u * (3u * ABSORBED + c), (*toll).taken[c]);
        count_wide(first + 2u * (3u * LOST + c), (*toll).lost[c]);
    }
    count_wide(first + COLLISIONS, vec2((*toll).collisions, 0u));
    atomicAdd(&counters[first + FINISHED], (*toll).finished);
}
