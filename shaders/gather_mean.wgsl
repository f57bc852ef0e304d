// The means over pixels: sums over their rays, always in the same order.

struct Pixel {
    order1: vec3<f32>,
    spare: f32,
    transmittance: vec3<f32>,
    spare_too: f32,
    background: vec3<f32>,
    spare_again: f32,
    emitted: vec3<f32>,
    spare_at_last: f32,
    source: vec4<f32>,
}

@group(0) @binding(28) var<storage, read_write> means: array<Pixel>;
// The share of each ray in its pixel.
@group(0) @binding(23) var<storage, read> weights: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let at = id.y * groups.x * 64u + id.x;
    if at >= job.pixels {
        return;
    }
    let count = rays_per_pixel();
    var mean = Pixel(vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0, vec3(0.0), 0.0, vec4(0.0));
    for (var i = 0u; i < count; i++) {
        let s = sums[at * count + i];
        let weight = weights[at * count + i];
        mean.order1 += weight * s.order1;
        let through = rgb(expos(-spectrum(scene.extinction) * s.column));
        mean.transmittance += weight * through;
        mean.background += weight * through * backdrop(view_place(pixels[at], share_of(i)));
        mean.emitted += weight * rgb(emitted_by(at * count + i));
        mean.source += weight * s.source;
    }
    means[at] = mean;
}
