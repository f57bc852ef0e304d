// The light grid: the column densities between a light and the voxel centres, and one layer of centres beyond each
// face, where they are such that interpolation is right on the face. One light ray for each node.

struct Job {
    // The first node of this dispatch, and the end of all.
    first: u32,
    end: u32,
    // The light.
    light: u32,
    spare: u32,
}

@group(0) @binding(5) var<uniform> job: Job;
@group(0) @binding(24) var<storage, read_write> columns: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let at = job.first + id.y * groups.x * 64u + id.x;
    if at >= job.end {
        return;
    }
    let n = vec3<u32>(scene.n) + 2u;
    let p = vec3<f32>(vec3(at % n.x, at / n.x % n.y, at / (n.x * n.y))) - 0.5;
    let light = lights[job.light];
    // Nodes beyond a face carry on the line through the centre before it and the face.
    let face = clamp(p, vec3(0.0), vec3<f32>(scene.n));
    let depth = light_ray(face, incident(light, face));
    if all(face == p) {
        columns[at] = depth;
        return;
    }
    let mirrored = 2.0 * face - p;
    columns[at] = 2.0 * depth - light_ray(mirrored, incident(light, mirrored));
}
