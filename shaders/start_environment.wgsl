// The same radiance from all directions: cosines to the box's faces are distributed as themselves.

fn start(j: u32, f: ptr<function, Flight>) -> Start {
    let u = stratum(j, start_words(f).x);
    let word = start_words(f);
    let face = pick_face(u);
    let side = select(1.0, 0.0, face.rest < 0.5);
    (*f).p = on_face(face.axis, side, 2.0 * face.rest - side, unit(word.x));
    var inward = vec3(0.0);
    inward[face.axis] = 1.0 - 2.0 * side;
    let b = unit(word.y);
    (*f).d = rotate(inward, sqrt(b), sqrt(1.0 - b), unit(word.z));
    return Start(FLIES, spectrum(emitter.colour));
}
