// Lines through the voxel grid: where they leave it, and which cells they cross. Positions are in voxels, velocities in
// voxels per length.

const FAR = 3.0e38;

// p + t v.
fn along(p: vec3<f32>, v: vec3<f32>, t: f32) -> vec3<f32> {
    return p + v * t;
}

// The largest integers not above x.
fn floors(x: vec3<f32>) -> vec3<i32> {
    return vec3<i32>(floor(x));
}

// A walk through the unit cells that a line crosses (Amanatides and Woo 1987). Progress is made in integers, so that
// rounding can neither stop it nor lead it off the grid.
struct Dda {
    cell: vec3<i32>,
    low: vec3<i32>,
    high: vec3<i32>,
    step: vec3<i32>,
    next: vec3<f32>,
    delta: vec3<f32>,
}

// Starts in the cell of q, moved onto the grid of cells low..high if rounding put it outside.
fn dda(q: vec3<f32>, v: vec3<f32>, low: vec3<i32>, high: vec3<i32>) -> Dda {
    var walk = Dda(clamp(floors(q), low, high - 1), low, high, vec3(0), vec3(FAR), vec3(FAR));
    for (var a = 0; a < 3; a++) {
        if v[a] != 0.0 {
            let inverse = 1.0 / v[a];
            let up = v[a] > 0.0;
            walk.step[a] = select(-1, 1, up);
            let edge = f32(walk.cell[a] + select(0, 1, up));
            walk.next[a] = max((edge - q[a]) * inverse, 0.0);
            walk.delta[a] = abs(inverse);
        }
    }
    return walk;
}

// The axis whose face is crossed next.
fn dda_axis(walk: ptr<function, Dda>) -> i32 {
    let next = (*walk).next;
    if next.x < next.y {
        return select(2, 0, next.x < next.z);
    }
    return select(2, 1, next.y < next.z);
}

// Steps over the face of an axis; false if that leaves the grid.
fn dda_advance(walk: ptr<function, Dda>, axis: i32) -> bool {
    let at = (*walk).cell[axis] + (*walk).step[axis];
    (*walk).cell[axis] = at;
    (*walk).next[axis] += (*walk).delta[axis];
    return at >= (*walk).low[axis] && at < (*walk).high[axis];
}
