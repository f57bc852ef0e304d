// The photon walk flight by flight, with any tracker and any weights.

// Flights of a photon before slots whose photons have ended take their next ones.
override EVENTS: u32 = 4u;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let slot = id.y * groups.x * 64u + id.x;
    if slot >= job.slots {
        return;
    }
    var photon = photon_of(slot);
    var f = photon.flight;
    var toll: Toll;
    toll.copy = slot % COPIES;
    for (var round = 0u; round < job.rounds && photon.state != OVER; round++) {
        if photon.state == NEXT {
            take_next(&photon, &f);
        }
        // The share of the energy that the photon ends in.
        var share = ABSORBED;
        if photon.state == STARTS {
            let begun = start(photon.number, &f);
            photon.weights = new_weights(begun.weight, 0u);
            if begun.how == MISSES {
                share = MISSED;
                photon.state = NEXT;
            } else if begun.how != SEARCHES {
                if DRAWS_HERO {
                    photon.weights = new_weights(begun.weight, start_words(&f).x);
                }
                photon.state = select(FLIGHT, HITS, begun.how == COLLIDES);
            }
        }
        for (var event = 0u; event < EVENTS && photon.state > STARTS; event++) {
            if photon.state != HITS {
                share = fly_on(&photon, &f);
            }
            if photon.state == HITS {
                share = collide(&photon, &f, &toll);
            }
        }
        if photon.state == NEXT {
            finish(&photon, &toll, share, rounding(start_words(&f).x));
        }
    }
    tell(&toll);
    photon.flight = f;
    photons[slot] = photon;
}

// A flight, or a part of it; gives the share of the energy that the photon ends in, if it leaves.
fn fly_on(photon: ptr<function, Photon>, f: ptr<function, Flight>) -> u32 {
    score_direction = (*f).d;
    score_order = (*photon).order;
    let left = select((*f).depth, -1.0, (*photon).state == FLIGHT);
    var way = Way((*f).p, (*f).d * scene.inverse_h, left, (*f).word, 0u);
    var w = (*photon).weights;
    var draws = Draws(scene.seed, (*f).index, (*f).block, 0u);
    let went = fly(&way, &w, &draws);
    (*photon).weights = w;
    (*f).p = way.p;
    (*f).depth = way.free;
    (*f).word = way.word;
    (*f).block = draws.block;
    (*photon).state = select(select(PAUSED, NEXT, went == LEFT), HITS, went == COLLIDED);
    return select(ESCAPED + way.face, UNSCATTERED, (*photon).order == 0u);
}

// Absorbs and scatters at a collision; gives the share of the energy that the photon ends in, if it does.
fn collide(photon: ptr<function, Photon>, f: ptr<function, Flight>, toll: ptr<function, Toll>) -> u32 {
    (*toll).collisions += 1u;
    let word = start_words(f);
    let before = unbiased((*photon).weights);
    (*photon).weights.value *= albedo_read((*f).p, word.z);
    let after = unbiased((*photon).weights);
    // Rounded as the CPU rounds it, at each collision.
    // Nothing that this collision leaves depends on the azimuth's word, which rounds it.
    let xi = rounding(word.y);
    add_taken(toll, before - after, xi);
    let order = (*photon).order;
    (*photon).order += 1u;
    (*photon).state = FLIGHT;
    let top = largest(after);
    if top <= 0.0 {
        (*photon).state = NEXT;
    } else if order >= scene.last {
        (*photon).state = NEXT;
        return TRUNCATED;
    } else if UNLIMITED && top < ROULETTE {
        if unit(word.w) > SURVIVAL {
            add_lost(toll, after, xi);
            (*photon).state = NEXT;
            return LOST;
        }
        (*photon).weights.value *= 1.0 / SURVIVAL;
        add_lost(toll, after - unbiased((*photon).weights), xi);
    }
    let polar = phase_sample(unit(word.x));
    (*f).d = rotate((*f).d, polar.x, polar.y, unit(word.y));
    return ABSORBED;
}
