// A point light, whose photons fill a cone around the box.

// Whether it is so far outside that its place is told from the box's centre.
override OUTSIDE: bool = false;

fn start(j: u32, f: ptr<function, Flight>) -> Start {
    let u = part(stratum(j, start_words(f).x));
    let a = unit(start_words(f).x);
    let v = emitter.cap * u;
    let cos_theta = 1.0 - v;
    let sin_theta = sqrt(v * (2.0 - v));
    let d = rotate(emitter.axis, cos_theta, sin_theta, a);
    (*f).d = d;
    var p = emitter.place;
    if OUTSIDE {
        // The point of the ray that is nearest to the box's centre, which loses nothing however far away the light is.
        let pair = orthonormal(emitter.axis);
        let turn = sin_cos_turn(a);
        let across = turn.y * pair.u + turn.x * pair.v;
        p += emitter.distance * sin_theta * (cos_theta * across - sin_theta * emitter.axis);
        p *= scene.inverse_h;
    }
    let way = d * scene.inverse_h;
    let range = box_range(p, way, vec3<f32>(scene.n));
    let enter = select(max(range.x, 0.0), range.x, OUTSIDE);
    if !(range.x < range.y && enter < range.y) {
        return Start(MISSES, spectrum(emitter.colour));
    }
    (*f).p = clamp(p + way * enter, vec3(0.0), vec3<f32>(scene.n));
    return Start(FLIES, spectrum(emitter.colour));
}
