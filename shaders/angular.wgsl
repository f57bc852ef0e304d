// From spherical harmonics of the incident radiance to what scatters towards an eye: J = sum of p_l L_lm Y_lm(to the
// eye). One value of a voxel for each invocation.

struct Job {
    // Voxels along x, y, z, and the order of the harmonics.
    n: vec3<u32>,
    order: u32,
    // Spacing, and the first voxel of this dispatch.
    h: vec3<f32>,
    first: u32,
    // The eye: a point in voxels (w = 1), or a direction towards it (w = 0).
    eye: vec4<f32>,
    // Values of a voxel (channels, replicates), and all values of this dispatch.
    inner: u32,
    count: u32,
    spare: vec2<u32>,
}

@group(0) @binding(5) var<uniform> job: Job;
// p_l.
@group(0) @binding(24) var<storage, read> moments: array<f32>;
@group(0) @binding(25) var<storage, read> coefficients: array<f32>;
@group(0) @binding(26) var<storage, read_write> towards: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let at = id.y * groups.x * 64u + id.x;
    if at >= job.count {
        return;
    }
    let voxel = at / job.inner;
    let cell = job.first + voxel;
    let centre = vec3<f32>(vec3(cell % job.n.x, cell / job.n.x % job.n.y, cell / (job.n.x * job.n.y))) + 0.5;
    let d = to_eye(job.eye, centre, job.h);
    let harmonics = (job.order + 1u) * (job.order + 1u);
    let base = voxel * harmonics * job.inner + at % job.inner;
    var sum = 0.0;
    for (var h = first_harmonic(); h.m <= job.order; h = next_harmonic(h, d, job.order)) {
        let index = harmonic_index(h);
        let y = moments[h.l] * harmonic_pair(h);
        sum += y.y * coefficients[base + index.y * job.inner];
        if h.m > 0u {
            sum += y.x * coefficients[base + index.x * job.inner];
        }
    }
    towards[at] = sum;
}
