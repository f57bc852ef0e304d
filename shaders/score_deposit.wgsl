// Flights leave weight times length in voxels.

// Adds weight times length around the point p of a voxel; xi within (0, 1] rounds.
fn score(voxel: u32, p: vec3<f32>, value: Spectrum, xi: f32) {
    deposit(voxel, p, score_direction, score_order, value * spectrum(job.units), xi);
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
            score(index_of(walk.cell), along(start, v, 0.5 * (t + stop)), value * (stop - t), rounding(bits));
            t = stop;
        }
        if exit >= end || !dda_advance(&walk, axis) {
            break;
        }
    }
}
