// What the medium emits towards the eye along a view ray. One ray for each invocation; a dispatch follows it through
// some cells.

@group(0) @binding(21) var<storage, read_write> busy: atomic<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let at = id.y * groups.x * 64u + id.x;
    if at >= job.rays || (job.begin == 0u && glows[at].over == 1u) {
        return;
    }
    let seen = ray_of(at);
    var glow = glow_start(seen.p, seen.v);
    if job.begin == 0u {
        glow = glows[at];
    }
    glow_from(seen.p, seen.v, seen.length, &glow, job.steps);
    glows[at] = glow;
    if glow.over == 0u {
        atomicAdd(&busy, 1u);
    }
}
