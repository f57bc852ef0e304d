// Flights leave weight times length in voxels.

// Adds weight times length around the point p of a voxel; xi within (0, 1] rounds.
fn score(voxel: u32, p: vec3<f32>, value: Spectrum, xi: f32) {
    deposit(voxel, p, score_direction, score_order, value * spectrum(job.units), xi);
}

// Whether what is absorbed is scored too.
fn scores_absorption() -> bool {
    return absorbs(score_order);
}

// Adds what of weight times length is absorbed at p, a point of the given density that was drawn evenly from where the value
// is for.
fn score_absorbed(voxel: u32, p: vec3<f32>, density: f32, value: Spectrum, xi: f32) {
    deposit_absorbed(voxel, p, density, value * spectrum(job.units), xi);
}

// Voxel by voxel along a line from t0 to t1, weight times length.
fn score_track(p: vec3<f32>, v: vec3<f32>, t0: f32, t1: f32, value: Spectrum, word: u32) {
    let end = t1 - t0;
    if end <= 0.0 {
        return;
    }
    let start = along(p, v, t0);
    var walk = dda(start, v, vec3(0), scene.n);
    var t = 0.0;
    var bits = word;
    loop {
        let axis = dda_axis(&walk);
        let exit = walk.next[axis];
        let stop = min(exit, end);
        if stop > t {
            bits = next_word(bits);
            let voxel = index_of(walk.cell);
            score(voxel, along(start, v, 0.5 * (t + stop)), value * (stop - t), rounding(bits));
            if scores_absorption() {
                let there = along(start, v, t + random_part(bits) * (stop - t));
                score_absorbed(voxel, there, density_at(there), value * (stop - t), rounding(bits));
            }
            t = stop;
        }
        if exit >= end || !dda_advance(&walk, axis) {
            break;
        }
    }
}
