// Unscattered light: where it comes from at a point, and what of it arrives there.

struct Light {
    // A point in voxels, or the unit vector along which parallel light travels.
    place: vec3<f32>,
    // 1 for a point.
    is_point: u32,
    // Intensity or irradiance by channel.
    value: vec3<f32>,
    // 1 where the depth is found by a light ray from every point.
    rays: u32,
    // The layer where its light grid begins in `nodes`, and 1 if it has one.
    first: u32,
    has_nodes: u32,
    // The chance of a light ray that puts the interpolated depth right.
    check: f32,
    spare: u32,
}

@group(0) @binding(6) var<storage, read> lights: array<Light>;
// The light grids one above the other.
@group(0) @binding(7) var nodes: texture_3d<f32>;

struct Incident {
    // Unit vector along which light travels.
    direction: vec3<f32>,
    // 1 / distance^2 of a point light; 1 for parallel light.
    falloff: f32,
    // Way from the light; infinite for parallel light.
    distance: f32,
}

// Direction and falloff at a point.
fn incident(light: Light, p: vec3<f32>) -> Incident {
    if light.is_point == 0u {
        return Incident(light.place, 1.0, FAR);
    }
    let r = (p - light.place) * scene.h;
    let d2 = max(r.x * r.x + r.y * r.y + r.z * r.z, 1e-30);
    let distance = sqrt(d2);
    return Incident(r / distance, 1.0 / d2, distance);
}

// The column density at a node.
fn node(at: vec3<i32>) -> f32 {
    return textureLoad(nodes, at, 0).x;
}

// Interpolates between the nodes of a light grid: the voxel centres, and one layer of centres beyond each face.
fn interpolate_nodes(first: u32, p: vec3<f32>) -> f32 {
    let q = max(p + 0.5, vec3(0.0));
    let cell = min(vec3<i32>(q), scene.n);
    let u = q - vec3<f32>(cell);
    let a = cell + vec3(0, 0, i32(first));
    let low = vec4(node(a), node(a + vec3(0, 1, 0)), node(a + vec3(0, 0, 1)), node(a + vec3(0, 1, 1)));
    let b = a + vec3(1, 0, 0);
    let high = vec4(node(b), node(b + vec3(0, 1, 0)), node(b + vec3(0, 0, 1)), node(b + vec3(0, 1, 1)));
    let x = low + u.x * (high - low);
    let y0 = x.x + u.y * (x.y - x.x);
    let y1 = x.z + u.y * (x.w - x.z);
    return max(y0 + u.z * (y1 - y0), 0.0);
}

// The column density by a light ray, exact.
fn light_ray(p: vec3<f32>, at: Incident) -> f32 {
    return column(p, -at.direction / scene.h, at.distance, scene.enough);
}

// Close to a point light the depth has the kink of a cone, and is not interpolated.
fn is_near(light: Light, p: vec3<f32>) -> bool {
    return light.is_point == 1u && all(abs(p - light.place) < vec3(2.0));
}

// The column density between the light and a point: interpolated, or by a light ray where that would be wrong.
fn light_column(light: Light, p: vec3<f32>, at: Incident) -> f32 {
    if light.has_nodes == 1u && light.rays == 0u && !is_near(light, p) {
        return interpolate_nodes(light.first, p);
    }
    return light_ray(p, at);
}

// The column density interpolated in the light grid wherever there is one.
fn rough_column(light: Light, p: vec3<f32>, at: Incident) -> f32 {
    if light.has_nodes == 1u {
        return interpolate_nodes(light.first, p);
    }
    return light_ray(p, at);
}
