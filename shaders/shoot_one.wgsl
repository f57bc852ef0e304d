// The photon walk flight by flight, with any tracker and any weights.

// Flights of a photon before slots whose photons have ended take their next ones.
override EVENTS: u32 = 4u;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let slot = id.y * groups.x * 64u + id.x;
    if slot >= job.slots {
        return;
    }
    let copy = slot % COPIES;
    var photon = photons[slot];
    var number = photon.number;
    var state = photon.state;
    var order = photon.order;
    var direction = photon.d;
    var w = load_weights(photon);
    var way = Way(photon.p, direction * scene.inverse_h, photon.depth, photon.word, 0u);
    var draws = Draws(scene.seed, add64(emitter.first, vec2(number, 0u)), photon.block, 0u);
    var collisions = 0u;
    var finished = 0u;
    var taken = array<vec2<u32>, CHANNELS>();
    var lost = array<vec2<u32>, CHANNELS>();
    for (var round = 0u; round < job.rounds && state != OVER; round++) {
        if state == NEXT {
            draws.index = add64(emitter.first, vec2(number, 0u));
            draws.block = 0u;
            order = 0u;
            state = select(OVER, STARTS, number < emitter.count);
        }
        // The share of the energy that the photon ends in.
        var share = ABSORBED;
        if state == STARTS {
            var f: Flight;
            f.index = draws.index;
            f.block = draws.block;
            let begun = start(number, &f);
            draws.block = f.block;
            way.p = f.p;
            direction = f.d;
            if begun.how == MISSES {
                w = new_weights(begun.weight, 0u);
                share = MISSED;
                state = NEXT;
            } else if begun.how != SEARCHES {
                var word = 0u;
                if DRAWS_HERO {
                    word = next4(&draws).x;
                }
                w = new_weights(begun.weight, word);
                state = select(FLIGHT, HITS, begun.how == COLLIDES);
            }
        }
        let waits = state == OVER || state == STARTS;
        for (var event = 0u; event < EVENTS && state > STARTS; event++) {
            if state == FLIGHT {
                way = set_out(way.p, direction * scene.inverse_h);
            }
            if state != HITS {
                score_direction = direction;
                score_order = order;
                let went = fly(&way, &w, &draws);
                state = PAUSED;
                if went == COLLIDED {
                    state = HITS;
                } else if went == LEFT {
                    share = select(ESCAPED + way.face, UNSCATTERED, order == 0u);
                    state = NEXT;
                }
            }
            if state == HITS {
                collisions += 1u;
                let word = next4(&draws);
                let before = unbiased(w);
                w.value *= albedo_read(way.p, word.z);
                let after = unbiased(w);
                add_weight(&taken, before - after);
                let top = largest(after);
                state = FLIGHT;
                if top <= 0.0 {
                    state = NEXT;
                } else if order >= scene.last {
                    share = TRUNCATED;
                    state = NEXT;
                } else if scene.last == 0xffffffffu && top < ROULETTE {
                    if unit(word.w) > SURVIVAL {
                        add_weight(&lost, after);
                        share = LOST;
                        state = NEXT;
                    } else {
                        w.value *= 1.0 / SURVIVAL;
                        add_weight(&lost, after - unbiased(w));
                    }
                }
                order += 1u;
                let polar = phase_sample(unit(word.x));
                direction = rotate(direction, polar.x, polar.y, unit(word.y));
            }
        }
        if state == NEXT && !waits {
            if share != ABSORBED && share != LOST {
                add_share(copy, share, unbiased(w));
            }
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
    photon.p = way.p;
    photon.d = direction;
    photon.depth = way.free;
    photon.word = way.word;
    photon.block = draws.block;
    photon.number = number;
    photon.state = state;
    photon.order = order;
    store_weights(&photon, w);
    photons[slot] = photon;
}
