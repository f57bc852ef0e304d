// The unscattered fluence of voxels next to a point light, or around it: the volume integral in the light's spherical
// coordinates, as integrals over the voxel's faces of (cosine / d^2) * integral of exp(-depth) dr. Each invocation
// finds a piece of a face.

struct Job {
    // The lowest of the voxels, and how many pieces there are.
    low: vec3<i32>,
    count: u32,
    // Voxels along each axis.
    size: vec3<u32>,
    spare: u32,
}

@group(0) @binding(5) var<uniform> job: Job;
// The pieces' parts of fluence times volume, of a light of value 1: channels fastest, then pieces, faces, voxels.
@group(0) @binding(24) var<storage, read_write> pieces: array<f32>;

// Pieces of a face along each axis.
const PIECES = 4u;
// Nodes and weights of Gauss-Legendre quadrature on [0, 1] with 4 points.
const NODES = array<f32, 4>(0.06943184, 0.33000948, 0.66999052, 0.93056816);
const WEIGHTS = array<f32, 4>(0.17392742, 0.32607258, 0.32607258, 0.17392742);

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let at = id.y * groups.x * 64u + id.x;
    if at >= job.count {
        return;
    }
    let voxel = at / (6u * PIECES * PIECES);
    let size = job.size;
    let cell = job.low + vec3<i32>(vec3(voxel % size.x, voxel / size.x % size.y, voxel / (size.x * size.y)));
    let sum = near_fluence(lights[0], cell, at / (PIECES * PIECES) % 6u, at % (PIECES * PIECES));
    for (var c = 0u; c < CHANNELS; c++) {
        pieces[CHANNELS * at + c] = channel(sum, c);
    }
}

// The part of a piece of the face -x +x -y +y -z +z.
fn near_fluence(light: Light, cell: vec3<i32>, face: u32, piece: u32) -> Spectrum {
    let axis = face / 2u;
    let side = face % 2u;
    let u = (axis + 1u) % 3u;
    let v = (axis + 2u) % 3u;
    // All relative to the light, which loses nothing.
    let low = vec3<f32>(cell) - light.place;
    let plane = low[axis] + f32(side);
    let distance = plane * scene.h[axis] * select(-1.0, 1.0, side == 1u);
    var sum = Spectrum();
    if distance <= 0.0 {
        return sum;
    }
    for (var at = 0u; at < 16u; at++) {
        var way = vec3(plane);
        way[u] = low[u] + (f32(piece % PIECES) + NODES[at % 4u]) / f32(PIECES);
        way[v] = low[v] + (f32(piece / PIECES) + NODES[at / 4u]) / f32(PIECES);
        let r = way * scene.h;
        let d2 = dot(r, r);
        let d = sqrt(d2);
        let weight = WEIGHTS[at % 4u] * WEIGHTS[at / 4u] / f32(PIECES * PIECES);
        let solid_angle = weight * (scene.h[u] * scene.h[v] / d2) * (distance / d);
        let end = light.place + way;
        let incident = incident(light, end);
        // The part of the ray within the voxel, as parts of its whole; it ends at this face.
        let parts = select(min(low / way, (low + 1.0) / way), vec3(0.0), way == vec3(0.0));
        let enter = max(max(max(parts.x, parts.y), parts.z), 0.0);
        if enter >= 1.0 {
            continue;
        }
        for (var k = 0u; k < 4u; k++) {
            let x = enter + (1.0 - enter) * NODES[k];
            let part = light.place + (end - light.place) * x;
            let here = Incident(incident.direction, incident.falloff, incident.distance * x);
            let column = light_ray(part, here);
            sum += solid_angle * WEIGHTS[k] * (1.0 - enter) * d * expos(-spectrum(scene.extinction) * column);
        }
    }
    return sum;
}
