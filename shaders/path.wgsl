// Paths from the camera by events. A slot takes every slots-th view ray, and the paths of each one after the other.

// Paths of a view ray between two looks at who needs the next ray, collisions of a path before the next path may begin, and
// tentative ones before it collides: slots do alike things at a time, for others wait where one does something long.
override ROUNDS: u32 = 4u;
override EVENTS: u32 = 8u;
override TENTATIVES: u32 = 8u;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let slot = job.slot + id.y * groups.x * 64u + id.x;
    if slot >= job.end || paths[slot].state == OVER {
        return;
    }
    var path = paths[slot];
    var flight = path.flight;
    var collisions = 0u;
    if path.state == NEW {
        path.ray = slot;
        path.state = VIEWS;
    }
    for (var step = 0u; step < job.steps && path.state != OVER; step++) {
        if path.state == VIEWS {
            path.state = OVER;
            if path.ray < job.rays {
                look(&path);
            }
        }
        for (var round = 0u; round < ROUNDS; round++) {
            if path.state == NEXT && path.begun < STARTS {
                begin(&path, &flight);
            }
            for (var event = 0u; event < EVENTS && path.state > NEXT; event++) {
                if path.state == HITS {
                    collisions += 1u;
                    path.state = select(FLIGHT, NEXT, collide(&path, &flight));
                }
                for (var k = 0u; k < TENTATIVES && path.state > HITS; k++) {
                    path.state = go_on(&path, &flight);
                }
            }
        }
        if path.state == NEXT && path.begun == STARTS {
            show(&path);
        }
    }
    path.flight = flight;
    paths[slot] = path;
    if path.state != OVER {
        atomicAdd(&counters[0], 1u);
    }
    atomicAdd(&counters[1], collisions);
}

// Writes down what a view ray saw.
fn show(path: ptr<function, Path>) {
    let at = 2u * CHANNELS * (*path).ray;
    for (var c = 0u; c < CHANNELS; c++) {
        seen[at + c] = channel((*path).one, c) * (*path).share;
        seen[at + CHANNELS + c] = channel((*path).more, c) * (*path).share;
    }
    (*path).ray += job.slots;
    (*path).state = VIEWS;
}

// Absorbs at a collision, and connects it to the lights; whether the path ends there.
fn collide(path: ptr<function, Path>, f: ptr<function, Flight>) -> bool {
    draw_vertex(f);
    (*path).weights.value *= albedo_here(f);
    let after = unbiased((*path).weights);
    let top = largest(after);
    if top <= 0.0 || (*path).order >= scene.last {
        return true;
    }
    (*path).order += 1u;
    let order = (*path).order;
    if FAR_LIGHTS > 0u {
        see(path, order, after * scattered(f));
    }
    if UNLIMITED && top < ROULETTE {
        if !survives_here(f) {
            return true;
        }
        (*path).weights.value *= 1.0 / SURVIVAL;
    }
    if order < scene.last {
        connect_near(path, f);
    }
    connect_maps(path, f);
    if order == scene.last && !FLIES_OUT {
        return true;
    }
    (*path).chance = scatter(f);
    return false;
}
