// Samples of a map, and what it says of their directions and of others.

@group(0) @binding(5) var<uniform> job: vec4<u32>;
@group(0) @binding(24) var<storage, read> given: array<vec4<f32>>;
@group(0) @binding(25) var<storage, read_write> found: array<array<f32, 12>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&given) {
        return;
    }
    let towards = given[id.x].xyz;
    let drawn = map_sample(job.x, abs(towards.x), abs(towards.y));
    let there = map_radiance(job.x, towards);
    let again = map_radiance(job.x, drawn.d);
    found[id.x] = array(
        drawn.d.x, drawn.d.y, drawn.d.z, drawn.pdf, map_pdf(job.x, drawn.d), map_pdf(job.x, towards),
        there.x, there.y, there.z, again.x, again.y, again.z,
    );
}
