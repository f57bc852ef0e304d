// What the medium emits along flights up to their ends: its mean over flights is what arrives at their start.

// Remembers where a flight begins, and with which weights.
fn set_glow(path: ptr<function, Path>, f: ptr<function, Flight>) {
    (*path).from_point = (*f).p;
    (*path).before = (*path).weights;
}

// Adds what is emitted along a flight.
fn see_glow(path: ptr<function, Path>, f: ptr<function, Flight>, collided: bool) {
    let p = (*path).from_point;
    let v = (*f).d * scene.inverse_h;
    let way = ((*f).p - p) * scene.h;
    var length = sqrt(way.x * way.x + way.y * way.y + way.z * way.z);
    if !collided {
        length = leave(p, v).t;
    }
    see(path, (*path).order, emitted((*path).before, f, p, v, length));
}
