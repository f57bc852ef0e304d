// Free flights in closed form through a homogeneous medium.

// How flights score: at collisions, along the way, or not at all.
override SCORE: u32 = 0u;
const AT_COLLISIONS = 1u;
const ON_TRACK = 2u;

// Flies to the next collision, or out.
fn fly(way: ptr<function, Way>, w: ptr<function, Weights>, draws: ptr<function, Draws>) -> u32 {
    let p = (*way).p;
    let v = (*way).v;
    let word = next4(draws);
    let sigma_t = scene.constant * scene.top_extinction;
    let edge = leave(p, v);
    let free = exponential(word.x, draws) / max(sigma_t, 1e-30);
    if SCORE == ON_TRACK {
        score_track(p, v, 0.0, min(free, edge.t), unbiased(*w), word.w);
    }
    if free >= edge.t {
        (*way).face = face_of(edge.axis, v);
        return LEFT;
    }
    let at = within(along(p, v, free));
    if SCORE == AT_COLLISIONS {
        let value = unbiased(*w) / sigma_t;
        score(index_of(vec3<i32>(at)), at, value, rounding(word.w));
        if scores_absorption() {
            score_absorbed(index_of(vec3<i32>(at)), at, scene.constant, value, rounding(word.w));
        }
    }
    (*way).p = at;
    return COLLIDED;
}
