// View rays. Points of the image are counted in pixels from one that sees the middle of the box, and rays are given
// where they pass it, so that single precision loses nothing however far the eye is.

struct View {
    // Where the ray through that pixel's upper left corner passes the middle of the box, in voxels, and the distance of
    // the eye from there along the axis of view.
    passing: vec3<f32>,
    depth: f32,
    // What a pixel to the right adds to it, and the width of a pixel per distance, or at any.
    passing_x: vec3<f32>,
    pixel: f32,
    // What one down adds, and the image's width in pixels.
    passing_y: vec3<f32>,
    width: u32,
    // The direction of that ray, whose part along the axis of view is 1, and the column of that pixel.
    ahead: vec3<f32>,
    column: i32,
    // What a pixel to the right adds to it, and the row.
    ahead_x: vec3<f32>,
    row: i32,
    // What one down adds.
    ahead_y: vec3<f32>,
    spare: u32,
}

@group(0) @binding(24) var<uniform> view: View;

struct ViewRay {
    // Where it enters the medium, in voxels; at the eye if that is within.
    p: vec3<f32>,
    // Length within; 0 if it misses.
    length: f32,
    // Voxels per length.
    v: vec3<f32>,
    // Length from the eye to the entry.
    start: f32,
    // Unit direction away from the eye.
    direction: vec3<f32>,
}

// A point of a pixel, (0, 0) being its upper left corner and (1, 1) its lower right, in pixels from the view's own.
fn view_place(pixel: u32, part: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(vec2(i32(pixel % view.width) - view.column, i32(pixel / view.width) - view.row)) + part;
}

// The direction of the ray through a place, its part along the axis of view 1.
fn view_ahead(place: vec2<f32>) -> vec3<f32> {
    return view.ahead + place.x * view.ahead_x + place.y * view.ahead_y;
}

// The ray through a place.
fn view_ray(place: vec2<f32>) -> ViewRay {
    let q = view.passing + place.x * view.passing_x + place.y * view.passing_y;
    let d = view_ahead(place);
    let norm = sqrt(d.x * d.x + d.y * d.y + d.z * d.z);
    let direction = d / norm;
    let v = direction / scene.h;
    let eye = -view.depth * norm;
    let range = meet(q, v);
    let enter = max(range.x, eye);
    let length = select(0.0, range.y - enter, range.y > enter);
    let p = clamp(along(q, v, enter), vec3(0.0), vec3<f32>(scene.n));
    return ViewRay(p, length, v, enter - eye, direction);
}
