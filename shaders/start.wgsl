// Where the photons of an emitter start: what all kinds share.

struct Emitter {
    // 2^64 / photons of the batch, and the number of the first.
    step: vec2<u32>,
    first: vec2<u32>,
    // The weight of a photon by channel (of what is drawn by all channels, over its part of them), and photons of the batch.
    colour: vec3<f32>,
    count: u32,
    // Where a lamp stands, in voxels; if it is far away, at `distance` from the box's centre, that, in lengths from the box's
    // corner.
    place: vec3<f32>,
    distance: f32,
    // The axis of the cone of its light, or the direction of parallel light; 1 - cosine of the half angle.
    axis: vec3<f32>,
    cap: f32,
    // Areas of the faces normal to x, y, z as the light sees them, and the volume of a voxel over all first collisions.
    faces: vec3<f32>,
    scale: f32,
    // Parts of the light below which it enters through faces normal to x, and to x or y.
    below_x: vec2<u32>,
    below_y: vec2<u32>,
    // Rows of the table, cells of each, its rows in a layer.
    rows: u32,
    width: u32,
    height: u32,
    spare: u32,
    // What makes the mean of each channel 1, where directions or places are drawn by all channels together.
    factors: vec3<f32>,
}

@group(0) @binding(10) var<uniform> emitter: Emitter;

// What became of a photon's start: it misses the box, flies, is at a collision, or is still searched for.
const MISSES = 0u;
const FLIES = 1u;
const COLLIDES = 2u;
const SEARCHES = 3u;

struct Start {
    how: u32,
    weight: Spectrum,
}

// The part of the light, in 2^-64, of photon j: stratified over all of them.
fn stratum(j: u32, word: u32) -> vec2<u32> {
    return add64(times64(j, emitter.step), mul_high64(word, emitter.step));
}

// A part in 2^-64 as a number within (0, 1].
fn part(u: vec2<u32>) -> f32 {
    return (float64(u) + 0.5) * (1.0 / 18446744073709551616.0);
}

struct Face {
    axis: i32,
    rest: f32,
}

// The axis of a face chosen by area, and the rest of u within it.
fn pick_face(u: vec2<u32>) -> Face {
    if less64(u, emitter.below_x) {
        return Face(0, float64(u) / float64(emitter.below_x));
    }
    if less64(u, emitter.below_y) {
        return Face(1, float64(sub64(u, emitter.below_x)) / float64(sub64(emitter.below_y, emitter.below_x)));
    }
    let left = sub64(vec2(0xffffffffu), emitter.below_y);
    return Face(2, float64(sub64(u, emitter.below_y)) / max(float64(left), 1.0));
}

// The point of a face, (0, 0) to (1, 1), on the given side of the box.
fn on_face(axis: i32, side: f32, x: f32, y: f32) -> vec3<f32> {
    var p = vec3(0.0);
    let n = vec3<f32>(scene.n);
    let next = (axis + 1) % 3;
    let last = (axis + 2) % 3;
    p[axis] = side * n[axis];
    p[next] = x * n[next];
    p[last] = y * n[last];
    return p;
}

// The random words of a start; the block of the photon's numbers moves on.
fn start_words(f: ptr<function, Flight>) -> vec4<u32> {
    let four = words(scene.seed, (*f).index, (*f).block, 0u);
    (*f).block += 1u;
    return four;
}
