// Null collisions against a grid of majorants.

// Extinction coefficients that are nowhere exceeded, x fastest; and how each cell scores.
@group(0) @binding(4) var<storage, read> majorants: array<f32>;
@group(0) @binding(8) var<storage, read> cell_scores: array<u32>;

// weight / majorant at tentative collisions, or weight times length along the flight, where these are rare or impossible.
const AT_COLLISIONS = 1u;
const ON_TRACK = 2u;

// Flies on to the next collision, or out; it pauses after some steps.
fn fly(way: ptr<function, Way>, w: ptr<function, Weights>, draws: ptr<function, Draws>) -> u32 {
    let p = (*way).p;
    let v = (*way).v;
    if (*way).free < 0.0 {
        (*way).word = next4(draws);
        (*way).free = exponential((*way).word.x, draws);
    }
    var word = (*way).word;
    var free = (*way).free;
    let block = f32(scene.block);
    var cells = dda(p * (1.0 / block), v * (1.0 / block), vec3(0), scene.cells);
    // The last cells may reach over the box.
    let edge = leave(p, v);
    var t = 0.0;
    for (var step = 0u; step < STEPS; step++) {
        let c = cells.cell;
        let cell = u32((c.z * scene.cells.y + c.y) * scene.cells.x + c.x);
        let majorant = majorants[cell];
        let how = cell_scores[cell];
        let axis = dda_axis(&cells);
        let over = cells.next[axis];
        let exit = min(over, edge.t);
        let next = select(FAR, t + free / majorant, majorant > 0.0);
        if how == ON_TRACK {
            score_track(p, v, t, min(next, exit), unbiased(*w), word.w);
        }
        if next < exit {
            t = next;
            // A tentative collision. Kept within the cell's voxels, whose densities the majorant bounds.
            let low = vec3<f32>(c * scene.block);
            let high = vec3<f32>(min((c + 1) * scene.block, scene.n)) * (1.0 - 6e-8);
            let at = clamp(along(p, v, t), low, high);
            let here = density_read(at, word.y);
            if how == AT_COLLISIONS {
                let value = unbiased(*w) * (1.0 / majorant);
                score(index_of(vec3<i32>(at)), at, value, rounding(word.w));
                if scores_absorption() {
                    score_absorbed(index_of(vec3<i32>(at)), at, here, value, rounding(word.w));
                }
            }
            if decide(w, here * scene.top_extinction * (1.0 / majorant), unit(word.z)) {
                (*way).p = at;
                return COLLIDED;
            }
            word = next4(draws);
            free = exponential(word.x, draws);
        } else {
            free = max(free - max(exit - t, 0.0) * majorant, 0.0);
            t = max(t, exit);
            if over >= edge.t || !dda_advance(&cells, axis) {
                (*way).face = face_of(edge.axis, v);
                return LEFT;
            }
        }
    }
    (*way).p = clamp(along(p, v, t), vec3(0.0), vec3<f32>(scene.n));
    (*way).word = word;
    (*way).free = free;
    return FLYING;
}
