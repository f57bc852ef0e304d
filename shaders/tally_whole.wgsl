// Tallies in one buffer of lower and one of upper words.

@group(0) @binding(15) var<storage, read_write> tally_low: array<atomic<u32>>;
@group(0) @binding(16) var<storage, read_write> tally_high: array<atomic<u32>>;

fn add_low(bin: u32, units: u32) -> u32 {
    return atomicAdd(&tally_low[bin], units);
}

fn add_high(bin: u32, units: u32) {
    atomicAdd(&tally_high[bin], units);
}
