// A view ray on its way, from one dispatch to the next.

struct Job {
    // Rays of this batch, and rays per pixel and axis.
    rays: u32,
    samples: u32,
    // Steps of a dispatch, and 1 in the first.
    steps: u32,
    begin: u32,
    // Lights that there are.
    lights: u32,
    // Pixels of this batch.
    pixels: u32,
    // Sky maps behind the volume, and rays per axis by which they are seen within the share of a ray.
    maps: u32,
    finer: u32,
    // The channels of four values of the source volume.
    channels: vec4<u32>,
    // The constant radiance behind the volume.
    sky: vec3<f32>,
    // What the order of the points in a pixel counts by.
    stride: u32,
}

struct Sums {
    // The cell that it is in, and how far it has come.
    cell: vec3<i32>,
    t: f32,
    // Where it crosses the cell's next faces, and the column density so far.
    next: vec3<f32>,
    column: f32,
    // Order 1 so far, and the part of the cell that is due.
    order1: vec3<f32>,
    part: u32,
    // Four values of the source volume so far.
    source: vec4<f32>,
    // The light that is due, and 1 where the ray has ended.
    light: u32,
    over: u32,
    // Where the part of the step that is due for this light begins, and its width, in 64ths of the step; 0 for all of it.
    at: u32,
    width: u32,
}

@group(0) @binding(5) var<uniform> job: Job;
@group(0) @binding(20) var<storage, read_write> sums: array<Sums>;
@group(0) @binding(25) var<storage, read> pixels: array<u32>;

// Rays of a pixel.
fn rays_per_pixel() -> u32 {
    return job.samples * job.samples;
}

// The upper left corner of a ray's share of its pixel, in parts of a pixel.
fn share_of(ray: u32) -> vec2<f32> {
    return vec2(f32(ray % job.samples), f32(ray / job.samples)) / f32(job.samples);
}

// Where a ray passes its pixel: one in each of n by n squares, and one in each of n^2 columns and rows (after Kensler,
// Correlated multi-jittered sampling, 2013).
fn point_of(ray: u32) -> vec2<f32> {
    let n = job.samples;
    let parts = f32(n);
    let column = f32((ray / n + 1u) * job.stride % (n + 1u)) - 0.5;
    let row = parts + 0.5 - f32((ray % n + 1u) * job.stride % (n + 1u));
    return (vec2(f32(ray % n), f32(ray / n)) + vec2(column, row) / parts) / parts;
}

// The ray through its point.
fn ray_of(ray: u32) -> ViewRay {
    let count = rays_per_pixel();
    return view_ray(view_place(pixels[ray / count], point_of(ray % count)));
}
