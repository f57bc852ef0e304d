// Tallies: integers of 64 bits in two words, which all invocations add to in any order with the same sums. A file tally_*
// gives the words: add_low(bin, units), which returns what was there before, and add_high(bin, units).

// Adds a number of 64 bits (two's complement) to a bin.
fn add_wide(bin: u32, units: vec2<u32>) {
    let before = add_low(bin, units.x);
    let carry = units.y + u32(before + units.x < before);
    if carry != 0u {
        add_high(bin, carry);
    }
}

// Adds `value` (in units), rounded by xi.
fn add_units(bin: u32, value: f32, xi: f32) {
    add_wide(bin, wide_rounded(value, xi));
}
