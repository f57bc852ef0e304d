// Nothing is emitted.

// Remembers where a flight begins.
fn set_emitted(path: ptr<function, Path>, f: ptr<function, Flight>) {}

// Adds what is emitted along a flight.
fn see_emitted(path: ptr<function, Path>, f: ptr<function, Flight>, collided: bool) {}
