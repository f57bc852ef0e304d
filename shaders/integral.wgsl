// Integrals along lines, cell by cell.

// The integral of a field along p + t v, t from 0 to end within the medium, no further than where it exceeds `most`.
fn integral(field: texture_3d<f32>, p: vec3<f32>, v: vec3<f32>, end: f32, most: f32) -> f32 {
    let stop = min(end, leave(p, v).t);
    var walk = cells(p, v);
    var t = 0.0;
    var sum = 0.0;
    loop {
        let axis = dda_axis(&walk);
        let exit = walk.next[axis];
        let to = min(exit, stop);
        if to > t {
            sum += piece(field, walk.cell, p, v, t, to);
            t = to;
            if sum > most {
                break;
            }
        }
        if exit >= stop || !dda_advance(&walk, axis) {
            break;
        }
    }
    return sum;
}
