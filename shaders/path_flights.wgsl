// Paths by null-collision flights whose collisions all channels share: four random words an event.

// Puts a path at its first collision.
fn begin_at(f: ptr<function, Flight>, p: vec3<f32>) {
    (*f).p = p;
    (*f).word = words(scene.seed, (*f).index, 0u, PURPOSE);
    (*f).block = 1u;
    (*f).xi = unit((*f).word.z);
}

// The random words of a vertex: those of the event that led there.
fn draw_vertex(f: ptr<function, Flight>) {}

// The albedo at a vertex.
fn albedo_here(f: ptr<function, Flight>) -> Spectrum {
    return albedo_of(f);
}

// Whether roulette is survived at a vertex.
fn survives_here(f: ptr<function, Flight>) -> bool {
    return survives(f);
}

// The chance of a correcting light ray if one is taken, else 0.
fn correction(f: ptr<function, Flight>, check: f32) -> f32 {
    let below = u32(check * 1024.0);
    return select(0.0, f32(below) * (1.0 / 1024.0), ((*f).word.w & 1023u) < below);
}

// Random words of a connection.
fn connection_words(f: ptr<function, Flight>, purpose: u32) -> vec4<u32> {
    return words(scene.seed, (*f).index, (*f).block, purpose);
}

// Scatters into a new direction; gives its density where that matters.
fn scatter(f: ptr<function, Flight>) -> f32 {
    let before = (*f).d;
    turn(f);
    if !HAS_MAPS {
        return 1.0;
    }
    let after = (*f).d;
    let cosine = before.x * after.x + before.y * after.y + before.z * after.z;
    return phase_pdf(max(min(cosine, 1.0), -1.0));
}

// One event of a flight; gives what is to happen next.
fn go_on(path: ptr<function, Path>, f: ptr<function, Flight>) -> u32 {
    if (*path).state == FLIGHT {
        draw_flight(f);
    }
    let went = advance(f);
    if went == TENTATIVE {
        return select(FLIGHT, HITS, accept(f));
    }
    if went == FLYING {
        return PAUSED;
    }
    // The background seen through the medium is no part of the image.
    if SEES_OUT && (*path).order > 0u {
        see(path, (*path).order, (*path).weights.value * met((*f).d, (*path).chance));
    }
    return NEXT;
}
