// Emitted light along a view ray: the integral of source term times transmittance, exact in every cell, however thick
// or empty it is. One of the files glow_*.wgsl adds a cell's.

// What lies behind this optical depth is not seen, however bright it is.
const UNSEEN = 50.0;

// How far a ray has been followed.
struct Glow {
    // The walk over the cells.
    next: vec3<f32>,
    // The parameter, and the column density up to there.
    t: f32,
    cell: vec3<i32>,
    column: f32,
    // The light that was found.
    sum: Spectrum,
    // 1 at the end.
    over: u32,
}

// The emitted radiance that p + t v, t from 0 to length, sends to its start.
fn glow_along(p: vec3<f32>, v: vec3<f32>, length: f32) -> Spectrum {
    var glow = glow_start(p, v);
    glow_from(p, v, length, &glow, 0xffffffffu);
    return glow.sum;
}

// A ray that has not been followed yet.
fn glow_start(p: vec3<f32>, v: vec3<f32>) -> Glow {
    let walk = glow_cells(p, v);
    return Glow(walk.next, 0.0, walk.cell, 0.0, Spectrum(), 0u);
}

// Follows a ray through so many more cells.
fn glow_from(p: vec3<f32>, v: vec3<f32>, length: f32, glow: ptr<function, Glow>, cells: u32) {
    let stop = min(length, leave(p, v).t);
    var walk = glow_cells(p, v);
    walk.next = (*glow).next;
    walk.cell = (*glow).cell;
    for (var i = 0u; i < cells && (*glow).over == 0u; i++) {
        let axis = dda_axis(&walk);
        let exit = walk.next[axis];
        let to = min(exit, stop);
        if to > (*glow).t {
            glow_cell(p, v, walk.cell, to, glow);
            (*glow).t = to;
        }
        if !glow_seen((*glow).column) || exit >= stop || !dda_advance(&walk, axis) {
            (*glow).over = 1u;
        }
    }
    (*glow).next = walk.next;
    (*glow).cell = walk.cell;
}

// Whether anything is seen through a column density, in any channel.
fn glow_seen(column: f32) -> bool {
    return any(spectrum(scene.extinction) * column <= Spectrum(UNSEEN));
}
