// What the medium emits along flights up to their ends: its mean over flights is what arrives at their start.

// 1, or 3 if channels differ in it.
override PLANES: u32 = 1u;

// Remembers where a flight begins, and with which weights.
fn set_emitted(path: ptr<function, Path>, f: ptr<function, Flight>) {
    (*path).from_point = (*f).p;
    (*path).before = (*path).weights;
}

// Adds what is emitted along a flight.
fn see_emitted(path: ptr<function, Path>, f: ptr<function, Flight>, collided: bool) {
    let p = (*path).from_point;
    let v = (*f).d * scene.inverse_h;
    let way = ((*f).p - p) * scene.h;
    var length = sqrt(way.x * way.x + way.y * way.y + way.z * way.z);
    if !collided {
        length = leave(p, v).t;
    }
    see(path, (*path).order, emitted((*path).before, f, p, v, length));
}

// The source term's integral along p + t v, t from 0 to end.
fn emission_columns(p: vec3<f32>, v: vec3<f32>, end: f32) -> Spectrum {
    var rgb = vec3(emission_column(0u, p, v, end));
    if PLANES > 1u {
        rgb = vec3(rgb.x, emission_column(1u, p, v, end), emission_column(2u, p, v, end));
    }
    return spectrum(rgb);
}

// The source term at a point.
fn emissions_at(p: vec3<f32>) -> Spectrum {
    var rgb = vec3(emission_at(0u, p));
    if PLANES > 1u {
        rgb = vec3(rgb.x, emission_at(1u, p), emission_at(2u, p));
    }
    return spectrum(rgb);
}
