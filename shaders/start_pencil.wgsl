// A pencil beam, from where it enters the box.

fn start(j: u32, f: ptr<function, Flight>) -> Start {
    (*f).block += 2u;
    (*f).p = emitter.place;
    (*f).d = emitter.axis;
    return Start(FLIES, spectrum(emitter.colour));
}
