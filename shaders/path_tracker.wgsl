// Paths flight by flight, with any tracker and any weights.

// What the random numbers are for.
override PURPOSE: u32 = 0u;

// The random words of a vertex.
fn draw_vertex(f: ptr<function, Flight>) {
    (*f).word = next_words(f);
}

// The next four words of a path.
fn next_words(f: ptr<function, Flight>) -> vec4<u32> {
    let word = words(scene.seed, (*f).index, (*f).block, PURPOSE);
    (*f).block += 1u;
    return word;
}

// Puts a path at its first collision.
fn begin_at(f: ptr<function, Flight>, p: vec3<f32>) {
    (*f).p = p;
    (*f).block = 0u;
}

// The albedo at a vertex.
fn albedo_here(f: ptr<function, Flight>) -> Spectrum {
    return albedo_read((*f).p, (*f).word.z);
}

// Whether roulette is survived at a vertex.
fn survives_here(f: ptr<function, Flight>) -> bool {
    return unit((*f).word.w) <= SURVIVAL;
}

// The chance of a correcting light ray if one is taken, else 0.
fn correction(f: ptr<function, Flight>, check: f32) -> f32 {
    return select(0.0, check, unit(next_words(f).x) <= check);
}

// Random words of a connection.
fn connection_words(f: ptr<function, Flight>, purpose: u32) -> vec4<u32> {
    return next_words(f);
}

// Scatters into a new direction; gives its density where that matters.
fn scatter(f: ptr<function, Flight>) -> f32 {
    let polar = phase_sample(unit((*f).word.x));
    (*f).d = rotate((*f).d, polar.x, polar.y, unit((*f).word.y));
    if !HAS_MAPS {
        return 1.0;
    }
    return phase_pdf(polar.x);
}

// A flight, or a part of it; gives what is to happen next.
fn go_on(path: ptr<function, Path>, f: ptr<function, Flight>) -> u32 {
    if (*path).state == FLIGHT {
        set_emitted(path, f);
        (*f).depth = -1.0;
    }
    var way = Way((*f).p, (*f).d * scene.inverse_h, (*f).depth, (*f).word, 0u);
    var w = (*path).weights;
    var draws = Draws(scene.seed, (*f).index, (*f).block, PURPOSE);
    let went = fly(&way, &w, &draws);
    (*path).weights = w;
    (*f).p = way.p;
    (*f).depth = way.free;
    (*f).word = way.word;
    (*f).block = draws.block;
    if went == FLYING {
        return PAUSED;
    }
    // What is seen through the medium is no part of the image.
    if (*path).order > 0u {
        see_emitted(path, f, went == COLLIDED);
        if SEES_OUT && went == LEFT {
            see(path, (*path).order, unbiased(w) * met((*f).d, (*path).chance));
        }
    }
    return select(NEXT, HITS, went == COLLIDED);
}
