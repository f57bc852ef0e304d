// The cells of a volume of one density: those of other fields.

// 0.5 where those are linear between voxel centres, else 0.
override OFFSET: f32;

alias Contents = f32;

// The walk over the cells that a line crosses.
fn walk_cells(p: vec3<f32>, v: vec3<f32>) -> Dda {
    return dda(p - OFFSET, v, -vec3(i32(2.0 * OFFSET)), scene.n);
}

// What a cell holds.
fn contents_of(cell: vec3<i32>) -> Contents {
    return scene.constant;
}

// The density at a point of a cell.
fn density_in(contents: Contents, cell: vec3<i32>, p: vec3<f32>) -> f32 {
    return contents;
}
