// Linear in cos theta between given knots, normalised.

// The number of knots, at least 2; then cos theta, its density and its distribution at the knots, one after the other.
@group(0) @binding(3) var<storage, read> phase_table: array<f32>;

fn knots() -> u32 {
    return u32(phase_table[0]);
}

// P(cos theta) [1/sr].
fn phase_pdf(cos_theta: f32) -> f32 {
    let k = segment(1u, cos_theta);
    let densities = 1u + knots() + k;
    let c0 = phase_table[1u + k];
    let c1 = phase_table[2u + k];
    let p0 = phase_table[densities];
    let p1 = phase_table[densities + 1u];
    let t = min(max((cos_theta - c0) / (c1 - c0), 0.0), 1.0);
    return 0.5 * FRAC_1_PI * (p0 + (p1 - p0) * t);
}

// (cos theta, sin theta) from a uniform number: inversion of the quadratic distribution within the segment that holds
// xi.
fn phase_sample(xi: f32) -> vec2<f32> {
    let k = segment(1u + 2u * knots(), xi);
    let densities = 1u + knots() + k;
    let c0 = phase_table[1u + k];
    let c1 = phase_table[2u + k];
    let p0 = phase_table[densities];
    let p1 = phase_table[densities + 1u];
    let rest = max(xi - phase_table[densities + knots()], 0.0);
    let slope = (p1 - p0) / (c1 - c0);
    let root = sqrt(max(p0 * p0 + 2.0 * slope * rest, 0.0));
    let step = 2.0 * rest / max(p0 + root, 1e-30);
    return with_sine(1.0 - min(c0 + step, c1));
}

// The index k <= knots - 2 of the segment [table[k], table[k + 1]) that holds x, by bisection; `table` is where it begins
// in phase_table.
fn segment(table: u32, x: f32) -> u32 {
    let last = knots() - 2u;
    var k = 0u;
    // From the power of two that is not below last + 1.
    for (var step = 1u << (32u - countLeadingZeros(last)); step > 0u; step /= 2u) {
        let next = min(k + step, last);
        k = select(next, k, x < phase_table[table + next]);
    }
    return k;
}
