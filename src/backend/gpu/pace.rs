//! How much work a dispatch holds: as much as takes about a twentieth of a second.

use std::time::Instant;

/// Seconds of a dispatch, about: no desktop freezes, and Ctrl-C is heard.
const DISPATCH: f64 = 0.05;
/// Loop iterations of an invocation in one dispatch: a software adapter silently ends all loops after 65,535 of them.
pub const ITERATIONS: u32 = 60_000;

/// By how much the next dispatch may be larger than one that took since `began`, or should be smaller.
pub fn factor(began: Instant) -> f64 {
    (DISPATCH / began.elapsed().as_secs_f64().max(1e-9)).clamp(0.5, 2.0)
}

/// What the next dispatch is to hold, after one that held `amount` took since `began`: 1 at least, and at most `most`.
pub fn next(amount: u32, began: Instant, most: u32) -> u32 {
    ((f64::from(amount) * factor(began)).round() as u32).clamp(1, most.max(1))
}
