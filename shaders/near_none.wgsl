// No light stands in the medium or next to it.

// What near lights add to a view ray.
fn near_view(path: ptr<function, Path>, start: Start) {}

// What they add at a vertex.
fn connect_near(path: ptr<function, Path>, f: ptr<function, Flight>) {}
