// Inversion of the running optical depth, exact in voxels of constant density and between voxel centres.

// Whether voxels are scored.
override SCORES: bool = true;
// Parts of a voxel along each axis that a step crosses, each in one piece of the density.
override PARTS: i32 = 1;

// Flies on to the next collision, or out; it pauses after some steps.
fn fly(way: ptr<function, Way>, w: ptr<function, Weights>, draws: ptr<function, Draws>) -> u32 {
    let p = (*way).p;
    let v = (*way).v;
    if (*way).free < 0.0 {
        (*way).word = next4(draws);
        (*way).free = exponential((*way).word.x, draws);
    }
    var word = (*way).word;
    let free = (*way).free;
    let extinction = deciding(*w);
    let parts = vec3(PARTS);
    var cells = dda(p * vec3<f32>(parts), v * vec3<f32>(parts), vec3(0), scene.n * parts);
    var t = 0.0;
    var column = 0.0;
    for (var step = 0u; step < STEPS; step++) {
        let axis = dda_axis(&cells);
        let exit = cells.next[axis];
        let voxel = cells.cell / parts;
        let length = max(exit - t, 0.0);
        let step_column = scene.texel * march_piece(cells.cell, p, v, t, t + length);
        let left = free - column * extinction;
        let hits = step_column * extinction >= left && step_column > 0.0 && length > 0.0;
        var stop = max(exit, t);
        if hits {
            let goal = max(left, 0.0) / extinction / scene.texel;
            stop = march_invert(cells.cell, p, v, t, exit, goal);
        }
        if SCORES && stop > t {
            word.y = next_word(word.y);
            // With unequal extinctions the weight changes along the piece: taken at a random point of it, which is unbiased.
            var weight = *w;
            if CHANNELS > 1u {
                let end = t + random_part(word.y) * (stop - t) / max(length, 1e-30) * (exit - t);
                weight = survived(*w, column + scene.texel * march_piece(cells.cell, p, v, t, end));
            }
            let value = unbiased(weight) * (stop - t);
            score(index_of(voxel), along(p, v, 0.5 * (t + stop)), value, rounding(word.y));
            if scores_absorption() {
                // The same point as the weight's.
                let there = along(p, v, t + random_part(word.y) * (stop - t));
                score_absorbed(index_of(voxel), there, density_at(there), value, rounding(word.y));
            }
        }
        if hits {
            *w = collided(survived(*w, free / extinction));
            (*way).p = within(along(p, v, stop));
            return COLLIDED;
        }
        column += step_column;
        t = max(t, exit);
        if !dda_advance(&cells, axis) {
            *w = survived(*w, column);
            (*way).face = face_of(axis, v);
            return LEFT;
        }
    }
    *w = survived(*w, column);
    (*way).p = clamp(along(p, v, t), vec3(0.0), vec3<f32>(scene.n));
    (*way).word = word;
    (*way).free = max(free - column * extinction, 0.0);
    return FLYING;
}
