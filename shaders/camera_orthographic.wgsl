// All rays are parallel.

// The width of a pixel at the given distance from the eye.
fn pixel_width(distance: f32) -> f32 {
    return view.pixel;
}
