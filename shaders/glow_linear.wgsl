// Emitted light between voxel centres: density and source term are cubic along the ray, the optical depth quartic. Of
// pieces of at most half an optical depth four Gauss points integrate the source term and its product with the optical
// depth exactly, what is of higher order to about 1e-6.

// Largest optical depth of a piece.
const GLOW_PIECE = 0.5;
// No piece is shorter than this part of a cell.
const GLOW_SHORTEST = 1e-9;

// The walk over the cells.
fn glow_cells(p: vec3<f32>, v: vec3<f32>) -> Dda {
    return dda(p - 0.5, v, vec3(-1), scene.n);
}

// Adds the light of a cell, up to the parameter `to`, and its column density.
fn glow_cell(p: vec3<f32>, v: vec3<f32>, cell: vec3<i32>, to: f32, glow: ptr<function, Glow>) {
    let length = to - (*glow).t;
    let enter = along(p - (vec3<f32>(cell) + 0.5), v, (*glow).t);
    let way = length * v;
    let sigma = length * density_cubic(cell, enter, way);
    let shine = emission_cubic(cell, enter, way);
    let dark = Spectrum();
    if any(shine[0] != dark) || any(shine[1] != dark) || any(shine[2] != dark) || any(shine[3] != dark) {
        (*glow).sum += length * glow_pieces(shine, sigma, (*glow).column);
    }
    (*glow).column += column_up_to(sigma, 1.0);
}

// The light of a cell of unit length, behind a column density, from its source term and its density.
fn glow_pieces(shine: array<Spectrum, 4>, sigma: vec4<f32>, before: f32) -> Spectrum {
    let extinction = spectrum(scene.extinction);
    var sum = Spectrum();
    var at = 0.0;
    var column = 0.0;
    var step = 1.0;
    var through = expos(-extinction * before);
    while at < 1.0 && glow_seen(before + column) {
        // The thickest channel that is still seen.
        let seen = extinction * (before + column) <= Spectrum(UNSEEN);
        let top = largest(select(Spectrum(), extinction, seen));
        let end = min(at + step, 1.0);
        let beyond = column_up_to(sigma, end);
        if step > max(GLOW_SHORTEST, 1.2e-7 * at) && top * (beyond - column) > GLOW_PIECE {
            step *= 0.5;
            continue;
        }
        let way = end - at;
        let outer = glow_at(shine, sigma, at + 0.06943184 * way, column)
            + glow_at(shine, sigma, at + 0.93056816 * way, column);
        let inner = glow_at(shine, sigma, at + 0.33000948 * way, column)
            + glow_at(shine, sigma, at + 0.66999052 * way, column);
        sum += way * through * (0.17392742 * outer + 0.32607258 * inner);
        through = expos(-extinction * (before + beyond));
        at = end;
        column = beyond;
        step *= 2.0;
    }
    return sum;
}

// The source term at s, as seen through what lies between the column density `near` and there.
fn glow_at(shine: array<Spectrum, 4>, sigma: vec4<f32>, s: f32, near: f32) -> Spectrum {
    let within = near - column_up_to(sigma, s);
    return expos(spectrum(scene.extinction) * within) * (shine[0] + s * (shine[1] + s * (shine[2] + s * shine[3])));
}

// The integral of a cubic from 0 to s.
fn column_up_to(c: vec4<f32>, s: f32) -> f32 {
    return s * (c.x + s * (c.y / 2.0 + s * (c.z / 3.0 + s * c.w / 4.0)));
}
