// The cells between voxel centres, within which the density is linear along each axis.

alias Contents = Corners;

// The walk over the cells that a line crosses.
fn walk_cells(p: vec3<f32>, v: vec3<f32>) -> Dda {
    return cells(p, v);
}

// What a cell holds.
fn contents_of(cell: vec3<i32>) -> Contents {
    return corners(density, cell);
}

// The density at a point of a cell.
fn density_in(contents: Contents, cell: vec3<i32>, p: vec3<f32>) -> f32 {
    return scene.texel * corners_at(contents, local(p, cell));
}
