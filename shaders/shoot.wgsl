// The photon walk by events: starts, flights, scatterings, and what they leave in the tallies.

// Events of a photon before slots whose photons have ended take their next ones.
override EVENTS: u32 = 16u;

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
            photon.weights = Weights(begun.weight);
            if begun.how == MISSES {
                share = MISSED;
                photon.state = NEXT;
                f.word = start_words(&f);
            } else if begun.how != SEARCHES {
                photon.state = select(FLIGHT, HITS, begun.how == COLLIDES);
            }
        }
        for (var event = 0u; event < EVENTS && photon.state > STARTS; event++) {
            if photon.state == HITS {
                share = collide(&photon, &f, &toll);
            }
            if photon.state >= FLIGHT {
                if photon.state == FLIGHT {
                    draw_flight(&f);
                }
                let went = advance(&f);
                photon.state = PAUSED;
                if went == TENTATIVE {
                    let units = photon.weights.value * (spectrum(job.units) * f.free_path);
                    let voxel = index_of(vec3<i32>(f.q));
                    deposit(voxel, f.q, f.d, photon.order, units, rounding(f.word.w));
                    if absorbs(photon.order) {
                        let density = density_read(f.q, f.word.y);
                        deposit_absorbed(voxel, f.q, density, units, rounding(f.word.w));
                    }
                    photon.state = select(FLIGHT, HITS, accept(&f));
                } else if went == LEFT {
                    share = ESCAPED;
                    photon.state = NEXT;
                }
            }
        }
        if photon.state == NEXT {
            if share == ESCAPED {
                let v = f.d * scene.inverse_h;
                share = select(ESCAPED + face_of(leave(f.p, v).axis, v), UNSCATTERED, photon.order == 0u);
            }
            finish(&photon, &toll, share, rounding(f.word.w));
        }
    }
    tell(&toll);
    photon.flight = f;
    photons[slot] = photon;
}

// Absorbs and scatters at a real collision; gives the share of the energy that the photon ends in, if it does.
fn collide(photon: ptr<function, Photon>, f: ptr<function, Flight>, toll: ptr<function, Toll>) -> u32 {
    (*toll).collisions += 1u;
    let before = (*photon).weights.value;
    let after = before * albedo_of(f);
    (*photon).absorbed += before - after;
    (*photon).weights.value = after;
    (*photon).order += 1u;
    (*photon).state = FLIGHT;
    turn(f);
    let top = largest(after);
    if top <= 0.0 {
        (*photon).state = NEXT;
    } else if (*photon).order > scene.last {
        (*photon).state = NEXT;
        return TRUNCATED;
    } else if UNLIMITED && top < ROULETTE {
        if !survives(f) {
            add_lost(toll, after, rounding((*f).word.w));
            (*photon).state = NEXT;
            return LOST;
        }
        (*photon).weights.value = after * (1.0 / SURVIVAL);
        add_lost(toll, after - (*photon).weights.value, rounding((*f).word.w));
    }
    return ABSORBED;
}
