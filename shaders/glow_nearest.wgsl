// Emitted light in voxels of constant density and source term.

// The walk over the cells.
fn glow_cells(p: vec3<f32>, v: vec3<f32>) -> Dda {
    return dda(p, v, vec3(0), scene.n);
}

// Adds the light of a cell, up to the parameter `to`, and its column density.
fn glow_cell(p: vec3<f32>, v: vec3<f32>, cell: vec3<i32>, to: f32, glow: ptr<function, Glow>) {
    let length = to - (*glow).t;
    let column = length * density_cubic(cell, p, v).x;
    let extinction = spectrum(scene.extinction);
    let through = mean_transmittances(extinction * column) * expos(-extinction * (*glow).column);
    (*glow).sum += length * through * emission_cubic(cell, p, v)[0];
    (*glow).column += column;
}
