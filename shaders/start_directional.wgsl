// Parallel light, from where it enters the box.

fn start(j: u32, f: ptr<function, Flight>) -> Start {
    let u = stratum(j, start_words(f).x);
    let a = unit(start_words(f).x);
    let face = pick_face(u);
    (*f).p = on_face(face.axis, select(1.0, 0.0, emitter.axis[face.axis] > 0.0), face.rest, a);
    (*f).d = emitter.axis;
    return Start(FLIES, spectrum(emitter.colour));
}
