// Fields that are linear between voxel centres, and clamped at the border.

// Eight texels around a cell of interpolation: those at its lower x face, and at its upper.
struct Corners {
    low: vec4<f32>,
    high: vec4<f32>,
}

// The cell of interpolation (i, j, k), from -1 to n - 1.
fn corners(field: texture_3d<f32>, cell: vec3<i32>) -> Corners {
    let a = max(cell, vec3(0));
    let b = min(cell + 1, scene.n - 1);
    return Corners(
        vec4(
            texel(field, a),
            texel(field, vec3(a.x, b.y, a.z)),
            texel(field, vec3(a.x, a.y, b.z)),
            texel(field, vec3(a.x, b.y, b.z)),
        ),
        vec4(
            texel(field, vec3(b.x, a.y, a.z)),
            texel(field, vec3(b.x, b.y, a.z)),
            texel(field, vec3(b.x, a.y, b.z)),
            texel(field, b),
        ),
    );
}

// The interpolated value at u, each within [0, 1].
fn corners_at(c: Corners, u: vec3<f32>) -> f32 {
    let x = c.low + u.x * (c.high - c.low);
    let y0 = x.x + u.y * (x.y - x.x);
    let y1 = x.z + u.y * (x.w - x.z);
    return y0 + u.z * (y1 - y0);
}

// Coordinates within the cell of interpolation, kept within [0, 1].
fn local(p: vec3<f32>, cell: vec3<i32>) -> vec3<f32> {
    return clamp(p - 0.5 - vec3<f32>(cell), vec3(0.0), vec3(1.0));
}

// The value at a point.
fn value_at(field: texture_3d<f32>, p: vec3<f32>) -> f32 {
    let q = p - 0.5;
    let cell = clamp(floors(q), vec3(-1), scene.n - 1);
    return corners_at(corners(field, cell), clamp(q - vec3<f32>(cell), vec3(0.0), vec3(1.0)));
}

// A value whose mean over `word` is the value at the point, from one read: the point is jittered by up to half a voxel,
// and the voxel there taken (box filtering of the nearest value is linear interpolation).
fn one_read(field: texture_3d<f32>, p: vec3<f32>, word: u32) -> f32 {
    return texel(field, voxel_of(max(p + jitter(word), vec3(0.0))));
}

// The field along u + s w, u and w in a cell of interpolation, as the coefficients of a cubic in s.
fn cubic(field: texture_3d<f32>, cell: vec3<i32>, u: vec3<f32>, w: vec3<f32>) -> vec4<f32> {
    let c = corners(field, cell);
    let rise = c.high - c.low;
    let x0 = c.low + u.x * rise;
    let x1 = w.x * rise;
    let y0 = x0.xz + u.y * (x0.yw - x0.xz);
    let y1 = x1.xz + u.y * (x1.yw - x1.xz) + w.y * (x0.yw - x0.xz);
    let y2 = w.y * (x1.yw - x1.xz);
    let low = vec3(y0.x, y1.x, y2.x);
    let climb = vec3(y0.y, y1.y, y2.y) - low;
    return vec4(low + u.z * climb, 0.0) + vec4(0.0, w.z * climb);
}

// The integral over the piece from t0 to t1 of a line, within one cell: two Gauss points are exact for its cubic.
fn piece(field: texture_3d<f32>, cell: vec3<i32>, p: vec3<f32>, v: vec3<f32>, t0: f32, t1: f32) -> f32 {
    let c = corners(field, cell);
    let step = 0.21132487 * (t1 - t0);
    let base = p - (vec3<f32>(cell) + 0.5);
    let sum = corners_at(c, along(base, v, t0 + step)) + corners_at(c, along(base, v, t1 - step));
    return 0.5 * (t1 - t0) * sum;
}

// Where within [t0, t1] the integral from t0 reaches `goal`, in a cell that holds the line between them: Newton's method
// kept within its bracket.
fn invert(field: texture_3d<f32>, cell: vec3<i32>, p: vec3<f32>, v: vec3<f32>, t0: f32, t1: f32, goal: f32) -> f32 {
    let c = corners(field, cell);
    let start = corners_at(c, local(along(p, v, t0), cell));
    var low = t0;
    var high = t1;
    var t = 0.5 * (t0 + t1);
    for (var i = 0; i < 24; i++) {
        let here = corners_at(c, local(along(p, v, t), cell));
        let middle = corners_at(c, local(along(p, v, 0.5 * (t0 + t)), cell));
        let sum = (start + 4.0 * middle + here) * ((t - t0) * (1.0 / 6.0)) - goal;
        if sum > 0.0 {
            high = t;
        } else {
            low = t;
        }
        let newton = t - sum / max(here, 1e-30);
        let next = select(0.5 * (low + high), newton, newton > low && newton < high);
        if abs(next - t) <= 1e-6 * (t1 - t0) {
            return next;
        }
        t = next;
    }
    return t;
}

// The walk over the cells within which the field is one polynomial.
fn cells(p: vec3<f32>, v: vec3<f32>) -> Dda {
    return dda(p - 0.5, v, vec3(-1), scene.n);
}
