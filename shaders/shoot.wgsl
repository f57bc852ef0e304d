// The photon walk by events: starts, flights, scatterings, and what they leave in the tallies.

// Events of a photon before slots whose photons have ended take their next ones.
override EVENTS: u32 = 16u;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let slot = id.y * groups.x * 64u + id.x;
    if slot >= job.slots {
        return;
    }
    let copy = slot % COPIES;
    var photon = photons[slot];
    var f: Flight;
    f.p = photon.p;
    f.d = photon.d;
    f.block = photon.block;
    f.word = photon.word;
    f.at = photon.at;
    f.depth = photon.depth;
    f.xi = photon.xi;
    f.free_path = photon.free_path;
    f.index = add64(emitter.first, vec2(photon.number, 0u));
    var number = photon.number;
    var state = photon.state;
    var order = photon.order;
    var weight = spectrum(photon.weight);
    var absorbed = spectrum(photon.absorbed);
    var collisions = 0u;
    var finished = 0u;
    var taken = array<vec2<u32>, CHANNELS>();
    var lost = array<vec2<u32>, CHANNELS>();
    for (var round = 0u; round < job.rounds && state != OVER; round++) {
        if state == NEXT {
            f.index = add64(emitter.first, vec2(number, 0u));
            f.block = 0u;
            absorbed = spectrum(vec3(0.0));
            order = 0u;
            state = select(OVER, STARTS, number < emitter.count);
        }
        // The share of the energy that the photon ends in, and what of it remains then.
        var share = ABSORBED;
        if state == STARTS {
            let begun = start(number, &f);
            weight = begun.weight;
            if begun.how == MISSES {
                share = MISSED;
                state = NEXT;
            } else if begun.how == COLLIDES {
                state = HITS;
            } else if begun.how == FLIES {
                state = FLIGHT;
            }
        }
        let waits = state == OVER || state == STARTS;
        for (var event = 0u; event < EVENTS && state > STARTS; event++) {
            if state == HITS {
                collisions += 1u;
                let after = weight * albedo_of(&f);
                absorbed += weight - after;
                weight = after;
                order += 1u;
                turn(&f);
                let top = largest(after);
                state = FLIGHT;
                if top <= 0.0 {
                    state = NEXT;
                } else if order > scene.last {
                    share = TRUNCATED;
                    state = NEXT;
                } else if scene.last == 0xffffffffu && top < ROULETTE {
                    if survives(&f) {
                        weight = after * (1.0 / SURVIVAL);
                        add_weight(&lost, after - weight);
                    } else {
                        add_weight(&lost, after);
                        share = LOST;
                        state = NEXT;
                    }
                }
            }
            if state >= FLIGHT {
                if state == FLIGHT {
                    draw_flight(&f);
                }
                let went = advance(&f);
                state = PAUSED;
                if went == TENTATIVE {
                    let voxel = index_of(vec3<i32>(f.q));
                    deposit(voxel, f.q, f.d, order, weight * (job.unit * f.free_path), rounding(f.word.w));
                    state = select(FLIGHT, HITS, accept(&f));
                } else if went == LEFT {
                    share = ESCAPED;
                    state = NEXT;
                }
            }
        }
        if state == NEXT && !waits {
            if share == ESCAPED {
                let v = f.d * scene.inverse_h;
                let axis = leave(f.p, v).axis;
                share = select(ESCAPED + 2u * u32(axis) + u32(v[axis] > 0.0), UNSCATTERED, order == 0u);
            }
            if share != ABSORBED && share != LOST {
                add_share(copy, share, weight);
            }
            add_weight(&taken, absorbed);
            end(number, order, share);
            finished += 1u;
            number += job.slots;
        }
    }
    for (var c = 0u; c < CHANNELS; c++) {
        count_wide(copy * WORDS + 2u * (3u * ABSORBED + c), taken[c]);
        count_wide(copy * WORDS + 2u * (3u * LOST + c), lost[c]);
    }
    count_wide(copy * WORDS + COLLISIONS, vec2(collisions, 0u));
    atomicAdd(&counters[copy * WORDS + FINISHED], finished);
    photon.p = f.p;
    photon.d = f.d;
    photon.block = f.block;
    photon.word = f.word;
    photon.at = f.at;
    photon.depth = f.depth;
    photon.xi = f.xi;
    photon.free_path = f.free_path;
    photon.number = number;
    photon.state = state;
    photon.order = order;
    photon.weight = rgb(weight);
    photon.absorbed = rgb(absorbed);
    photons[slot] = photon;
}
