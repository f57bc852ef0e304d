// View rays: the part of a camera's ray that lies within the medium.

// Lengths are found from the plane through the box's centre, for beside a camera far away the box is smaller than its
// distance's last digit.
struct Camera {
    // Where the axis of view meets the plane, in voxels, and the way from the eye.
    centre: vec3<f32>,
    distance: f32,
    // What a pixel to the right and one down are on the plane, in voxels.
    right: vec3<f32>,
    down: vec3<f32>,
    // The axis of view, and what a pixel to the right and one down add to it.
    forward: vec3<f32>,
    aside: vec3<f32>,
    below: vec3<f32>,
    // The image's centre in pixels.
    middle: vec2<i32>,
    part: vec2<f32>,
}

@group(0) @binding(27) var<uniform> camera: Camera;

struct ViewRay {
    // Where it enters, in voxels; at the eye if that is within.
    p: vec3<f32>,
    // Length within; 0 if it misses the medium.
    length: f32,
    // Voxels per length.
    v: vec3<f32>,
    // Unit direction away from the eye.
    d: vec3<f32>,
}

// The ray through a place in a pixel, from its upper left corner.
fn view_ray(pixel: vec2<u32>, place: vec2<f32>) -> ViewRay {
    let at = vec2<f32>(vec2<i32>(pixel) - camera.middle) + (place - camera.part);
    let p = camera.centre + at.x * camera.right + at.y * camera.down;
    let way = camera.forward + at.x * camera.aside + at.y * camera.below;
    let norm = sqrt(way.x * way.x + way.y * way.y + way.z * way.z);
    let d = way / norm;
    let v = d * scene.inverse_h;
    let range = crossing(p, v);
    let from = max(range.x, -camera.distance * norm);
    let entry = clamp(p + v * from, vec3(0.0), vec3<f32>(scene.n));
    return ViewRay(entry, max(range.y - from, 0.0), v, d);
}
