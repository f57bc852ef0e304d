// Where the column density along a line reaches a given one, cell by cell.

// The parameter within [0, end]; the end of the last cell that holds any density if it is not reached.
fn reach(p: vec3<f32>, v: vec3<f32>, end: f32, wanted: f32) -> f32 {
    let goal = wanted / scene.texel;
    let stop = min(end, leave(p, v).t);
    var walk = cells(p, v);
    var t = 0.0;
    var sum = 0.0;
    var last = 0.0;
    loop {
        let axis = dda_axis(&walk);
        let exit = walk.next[axis];
        let to = min(exit, stop);
        if to > t {
            let whole = piece(density, walk.cell, p, v, t, to);
            if sum + whole > goal {
                return invert(density, walk.cell, p, v, t, to, max(goal - sum, 0.0));
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
