// The gather: what the volume sends to the eye along a view ray, front to back. Its source term is sigma_s * (order 1
// + J): order 1 from the lights directly, J interpolated between voxel centres. Cells within which the density is one
// polynomial are cut into steps of at most half an optical depth with two Gauss points each. One ray for each
// invocation; a dispatch makes some steps of it, of one light each.

// Largest optical depth of a step.
const STEP_DEPTH = 0.5;
// Steps of a cell at most: so many resolve what is seen of a density that grows from zero to 10^7 mean free paths.
const MOST_STEPS = 16777216.0;
// A ray ends where its transmittance is below exp(-this).
const OPAQUE = 12.0;
// Nodes of two Gauss points.
const U1 = 0.21132487;
const U2 = 0.7886751;

@group(0) @binding(21) var<storage, read_write> busy: atomic<u32>;

// A view ray within the box.
struct Ray {
    p: vec3<f32>,
    v: vec3<f32>,
    direction: vec3<f32>,
    // Nearest that it is taken to pass a light: a part of its share of the pixel.
    least_off: f32,
}

// The part of a ray within a cell.
struct Piece {
    cell: vec3<i32>,
    t0: f32,
    t1: f32,
    // Steps that it is cut into, none where there is nothing, and their length.
    parts: u32,
    step: f32,
    // Whether more than a cell is known to be empty, and whether the ray ends.
    is_clear: bool,
    is_last: bool,
    contents: Contents,
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let at = id.y * groups.x * 64u + id.x;
    if at >= job.rays || (job.begin == 0u && sums[at].over == 1u) {
        return;
    }
    let seen = ray_of(at);
    let least_off = 0.1 * pixel_width(seen.start + 0.5 * seen.length) / f32(job.samples);
    let ray = Ray(seen.p, seen.v, seen.direction, least_off);
    let end = min(seen.length, leave(ray.p, ray.v).t);
    var walk = walk_cells(ray.p, ray.v);
    var s = Sums(walk.cell, 0.0, walk.next, 0.0, vec3(0.0), 0u, vec4(0.0), 0u, select(1u, 0u, end > 0.0), 0u, 0u);
    if job.begin == 0u {
        s = sums[at];
        walk.cell = s.cell;
        walk.next = s.next;
    }
    var piece = next_piece(&walk, ray, s.t, end);
    for (var i = 0u; i < job.steps && s.over == 0u; i++) {
        if s.part < piece.parts {
            step(&s, ray, piece);
        }
        if s.part >= piece.parts || !is_seen(s.column) {
            s.part = 0u;
            s.t = max(s.t, piece.t1);
            if !is_seen(s.column) || piece.is_last || !(piece.is_clear || dda_advance(&walk, dda_axis(&walk))) {
                s.over = 1u;
                break;
            }
            piece = next_piece(&walk, ray, s.t, end);
        }
    }
    s.cell = walk.cell;
    s.next = walk.next;
    sums[at] = s;
    if s.over == 0u {
        atomicAdd(&busy, 1u);
    }
}

// Whether anything is seen through a column density.
fn is_seen(column: f32) -> bool {
    return column * min(min(scene.extinction.x, scene.extinction.y), scene.extinction.z) <= OPAQUE;
}

// What a ray meets from t0 on: the walk's cell, or nothing, to the end of which the walk is moved.
fn next_piece(walk: ptr<function, Dda>, ray: Ray, t0: f32, end: f32) -> Piece {
    var piece: Piece;
    piece.t0 = t0;
    let clear = clear_until(ray.p, ray.v, t0);
    piece.is_clear = clear > t0;
    if piece.is_clear {
        piece.is_last = clear >= end;
        piece.t1 = min(clear, end);
        *walk = walk_cells(along(ray.p, ray.v, piece.t1), ray.v);
        (*walk).next += piece.t1;
        return piece;
    }
    let cell = (*walk).cell;
    let exit = (*walk).next[dda_axis(walk)];
    let t1 = min(exit, end);
    piece.is_last = exit >= end;
    piece.cell = cell;
    piece.t1 = t1;
    if t1 > t0 {
        let length = t1 - t0;
        piece.contents = contents_of(cell);
        let s1 = density_in(piece.contents, cell, along(ray.p, ray.v, t0 + U1 * length));
        let s2 = density_in(piece.contents, cell, along(ray.p, ray.v, t0 + U2 * length));
        if s1 > 0.0 || s2 > 0.0 {
            let depth = 0.5 * (s1 + s2) * length * scene.top_extinction;
            let parts = clamp(ceil(depth / STEP_DEPTH), 1.0, MOST_STEPS);
            piece.parts = u32(parts);
            piece.step = length / parts;
        }
    }
    return piece;
}

// Adds what the light that is due makes a step send to the eye, and after the last one what the volumes do.
fn step(s: ptr<function, Sums>, ray: Ray, piece: Piece) {
    let start = piece.t0 + piece.step * f32((*s).part);
    let p1 = along(ray.p, ray.v, start + U1 * piece.step);
    let p2 = along(ray.p, ray.v, start + U2 * piece.step);
    let s1 = density_in(piece.contents, piece.cell, p1);
    let s2 = density_in(piece.contents, piece.cell, p2);
    let profile = Profile(s1, (s2 - s1) / (U2 - U1), piece.step);
    let f1 = factor(p1, s1 * 0.5 * piece.step, (*s).column + profile_column(profile, U1));
    let f2 = factor(p2, s2 * 0.5 * piece.step, (*s).column + profile_column(profile, U2));
    if (*s).light < job.lights {
        let light = lights[(*s).light];
        let near = close_light(light, along(ray.p, ray.v, start), ray.direction, piece.step);
        if near.is_close {
            (*s).order1 += rgb(close(light, near, ray, start, profile, (*s).column));
        } else if !lit(s, light, ray, start, profile) {
            return;
        }
        (*s).light += 1u;
        if (*s).light < job.lights {
            return;
        }
    }
    add_volumes(s, p1, f1);
    add_volumes(s, p2, f2);
    (*s).column += 0.5 * (s1 + s2) * piece.step;
    (*s).part += 1u;
    (*s).light = 0u;
}

// Adds what the volumes hold at a node.
fn add_volumes(s: ptr<function, Sums>, p: vec3<f32>, factor: Spectrum) {
    (*s).order1 += rgb(factor * source0_at(p));
    let c = job.channels;
    let factors = vec4(channel(factor, c.x), channel(factor, c.y), channel(factor, c.z), channel(factor, c.w));
    (*s).source += factors * source_at(p);
}

// sigma_s * length * transmittance at a node, by channel.
fn factor(p: vec3<f32>, weight: f32, column: f32) -> Spectrum {
    let extinction = spectrum(scene.extinction);
    return extinction * albedo_at(p) * weight * expos(-extinction * column);
}

// P from the light's direction into that towards the eye, which is against the view ray.
fn toward_eye(light: vec3<f32>, view: vec3<f32>) -> f32 {
    return phase_pdf(-clamp(light.x * view.x + light.y * view.y + light.z * view.z, -1.0, 1.0));
}
