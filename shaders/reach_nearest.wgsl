// Where the column density along a line reaches a given one, in voxels of constant density.

// The parameter within [0, end]; the end of the last voxel that holds any density if it is not reached.
fn reach(p: vec3<f32>, v: vec3<f32>, end: f32, wanted: f32) -> f32 {
    let target_sum = wanted / scene.texel;
    let stop = min(end, leave(p, v).t);
    var walk = dda(p, v, vec3(0), scene.n);
    var t = 0.0;
    var sum = 0.0;
    var last = 0.0;
    loop {
        let axis = dda_axis(&walk);
        let exit = walk.next[axis];
        let to = min(exit, stop);
        if to > t {
            let whole = texel(density, walk.cell) * (to - t);
            if sum + whole > target_sum {
                return min(t + (to - t) * min(max(target_sum - sum, 0.0) / max(whole, 1e-30), 1.0), to);
            }
            sum += whole;
            t = to;
            last = select(last, to, whole > 0.0);
        }
        if exit >= stop || !dda_advance(&walk, axis) {
            break;
        }
    }
    return last;
}
