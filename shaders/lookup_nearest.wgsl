// Fields that are constant within each voxel.

// The texel at a point.
fn value_at(field: texture_3d<f32>, p: vec3<f32>) -> f32 {
    return texel(field, voxel_of(p));
}

// The same: one read is enough.
fn one_read(field: texture_3d<f32>, p: vec3<f32>, word: u32) -> f32 {
    return value_at(field, p);
}

// The field along u + s w, u and w in a voxel, as the coefficients of a cubic in s.
fn cubic(field: texture_3d<f32>, cell: vec3<i32>, u: vec3<f32>, w: vec3<f32>) -> vec4<f32> {
    return vec4(texel(field, cell), 0.0, 0.0, 0.0);
}

// The largest texel that a lookup within a voxel can return.
fn maximum(field: texture_3d<f32>, cell: vec3<i32>) -> f32 {
    return texel(field, cell);
}

// The integral of the field along p + t v, t from 0 to end within the box, no further than where it exceeds `most`.
fn integral(field: texture_3d<f32>, p: vec3<f32>, v: vec3<f32>, end: f32, most: f32) -> f32 {
    let stop = min(end, leave(p, v).t);
    var walk = dda(p, v, vec3(0), scene.n);
    var t = 0.0;
    var sum = 0.0;
    loop {
        let axis = dda_axis(&walk);
        let exit = walk.next[axis];
        let to = min(exit, stop);
        if to > t {
            sum += texel(field, walk.cell) * (to - t);
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
