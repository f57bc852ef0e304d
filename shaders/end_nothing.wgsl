// A photon's end leaves no trace of its own.
fn end(number: u32, order: u32, share: u32) {}
