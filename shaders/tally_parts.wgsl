// Tallies in four buffers of lower and four of upper words, for adapters that bind no larger ones.

// Bins of each buffer.
override PART: u32 = 1u;

@group(0) @binding(40) var<storage, read_write> tally_low_0: array<atomic<u32>>;
@group(0) @binding(41) var<storage, read_write> tally_low_1: array<atomic<u32>>;
@group(0) @binding(42) var<storage, read_write> tally_low_2: array<atomic<u32>>;
@group(0) @binding(43) var<storage, read_write> tally_low_3: array<atomic<u32>>;
@group(0) @binding(44) var<storage, read_write> tally_high_0: array<atomic<u32>>;
@group(0) @binding(45) var<storage, read_write> tally_high_1: array<atomic<u32>>;
@group(0) @binding(46) var<storage, read_write> tally_high_2: array<atomic<u32>>;
@group(0) @binding(47) var<storage, read_write> tally_high_3: array<atomic<u32>>;

fn add_low(bin: u32, units: u32) -> u32 {
    let at = bin % PART;
    switch bin / PART {
        case 0u: {
            return atomicAdd(&tally_low_0[at], units);
        }
        case 1u: {
            return atomicAdd(&tally_low_1[at], units);
        }
        case 2u: {
            return atomicAdd(&tally_low_2[at], units);
        }
        default: {
            return atomicAdd(&tally_low_3[at], units);
        }
    }
}

fn add_high(bin: u32, units: u32) {
    let at = bin % PART;
    switch bin / PART {
        case 0u: {
            atomicAdd(&tally_high_0[at], units);
        }
        case 1u: {
            atomicAdd(&tally_high_1[at], units);
        }
        case 2u: {
            atomicAdd(&tally_high_2[at], units);
        }
        default: {
            atomicAdd(&tally_high_3[at], units);
        }
    }
}
