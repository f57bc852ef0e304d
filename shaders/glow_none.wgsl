// Nothing is emitted.

// Remembers where a flight begins.
fn set_glow(path: ptr<function, Path>, f: ptr<function, Flight>) {}

// Adds what is emitted along a flight.
fn see_glow(path: ptr<function, Path>, f: ptr<function, Flight>, collided: bool) {}
