// The mean unscattered fluence of voxels, and of density times fluence, for one light: Gauss points in each voxel.
// Either each has a light ray, or the columns of the light grid are shifted to be right at the voxel's centre.

struct Job {
    // The first voxel of this part of the volume, and how many there are.
    first: u32,
    count: u32,
    // Gauss points per axis of the densest voxel, and 1 where each has a light ray.
    points: u32,
    rays: u32,
    // Points of this dispatch, and 1 at the first.
    most: u32,
    begins: u32,
    // The column density that light can meet within one voxel, and the longest side of a voxel.
    reach: f32,
    side: f32,
}

// How far a voxel has come.
struct Progress {
    // The next point, and points per axis.
    at: u32,
    points: u32,
    // What is added to the columns of the light grid.
    shift: f32,
    spare: u32,
}

@group(0) @binding(5) var<uniform> job: Job;
@group(0) @binding(20) var<storage, read_write> progress: array<Progress>;
// 1 where any voxel is not done.
@group(0) @binding(21) var<storage, read_write> unfinished: atomic<u32>;
// Fluence of all voxels, channel by channel, and density * fluence.
@group(0) @binding(24) var<storage, read_write> means: array<f32>;

// Nodes and weights of Gauss-Legendre quadrature on [0, 1] with 1 to 4 points.
const GAUSS = array<vec2<f32>, 10>(
    vec2(0.5, 1.0),
    vec2(0.21132487, 0.5), vec2(0.7886751, 0.5),
    vec2(0.112701665, 0.2777778), vec2(0.5, 0.44444444), vec2(0.88729833, 0.2777778),
    vec2(0.06943184, 0.17392742), vec2(0.33000948, 0.32607258),
    vec2(0.66999052, 0.32607258), vec2(0.93056816, 0.17392742),
);

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let at = id.y * groups.x * 64u + id.x;
    if at >= job.count {
        return;
    }
    let voxel = job.first + at;
    let n = vec3<u32>(scene.n);
    let cell = vec3<i32>(vec3(voxel % n.x, voxel / n.x % n.y, voxel / (n.x * n.y)));
    let light = lights[0];
    var here: Progress;
    var fluence = Spectrum();
    var collisions = Spectrum();
    if job.begins == 1u {
        here = begin(light, cell);
    } else {
        here = progress[at];
        fluence = load(at, 0u);
        collisions = load(at, CHANNELS);
    }
    let all = here.points * here.points * here.points;
    let end = min(here.at + job.most, all);
    while here.at < end {
        let x = gauss_node(here.points, here.at % here.points);
        let y = gauss_node(here.points, here.at / here.points % here.points);
        let z = gauss_node(here.points, here.at / (here.points * here.points));
        let p = vec3<f32>(cell) + vec3(x.x, y.x, z.x);
        let incident = incident(light, p);
        let weight = x.y * y.y * z.y * incident.falloff;
        let column = point_column(light, p, incident, here.shift);
        let more = weight * spectrum(light.value) * expos(-spectrum(scene.extinction) * column);
        fluence += more;
        collisions += more * density_at(p);
        here.at += 1u;
    }
    store(at, 0u, fluence);
    store(at, CHANNELS, collisions);
    progress[at] = here;
    if here.at < all {
        atomicStore(&unfinished, 1u);
    }
}

// What a voxel begins with: no points where it is dark, or next to the light (where 1/d^2 is no polynomial).
fn begin(light: Light, cell: vec3<i32>) -> Progress {
    let centre = vec3<f32>(cell) + 0.5;
    if light.is_point == 1u && all(abs(centre - light.place) < vec3(3.0)) {
        return Progress(0u, 0u, 0.0, 0u);
    }
    let incident = incident(light, centre);
    var points = job.points;
    if points > 4u {
        if rough_column(light, centre, incident) - job.reach > scene.enough {
            return Progress(0u, 0u, 0.0, 0u);
        }
        // The plan's number is that of the densest voxel.
        points = min(points, points_for(density_maximum(cell) * scene.top_extinction * job.side));
    }
    var shift = 0.0;
    if light.rays == 1u && job.rays == 0u {
        shift = light_ray(centre, incident) - rough_column(light, centre, incident);
    }
    return Progress(0u, points, shift, 0u);
}

// Gauss points per axis that a voxel of an optical depth needs, 4 at least.
fn points_for(depth: f32) -> u32 {
    return select(select(16u, 8u, depth <= 12.0), 4u, depth <= 6.0);
}

// The node and the weight of a point along an axis: of more than 4 points each 4 have a piece of the voxel.
fn gauss_node(points: u32, at: u32) -> vec2<f32> {
    let rule = min(points, 4u);
    let pieces = f32((points + 3u) / 4u);
    let gauss = GAUSS[rule * (rule - 1u) / 2u + at % rule];
    return vec2((f32(at / rule) + gauss.x) / pieces, gauss.y / pieces);
}

// The column density between the light and a point.
fn point_column(light: Light, p: vec3<f32>, at: Incident, shift: f32) -> f32 {
    if job.rays == 1u {
        return light_ray(p, at);
    }
    return max(rough_column(light, p, at) + shift, 0.0);
}

// Sums from a plane on.
fn load(at: u32, plane: u32) -> Spectrum {
    var sum = vec3(0.0);
    for (var c = 0u; c < CHANNELS; c++) {
        sum[c] = means[(plane + c) * job.count + at];
    }
    return spectrum(sum);
}

// Keeps sums from a plane on.
fn store(at: u32, plane: u32, sum: Spectrum) {
    for (var c = 0u; c < CHANNELS; c++) {
        means[(plane + c) * job.count + at] = channel(sum, c);
    }
}
