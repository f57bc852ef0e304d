// The environment behind the volume has one radiance.

// The mean radiance over a ray's share of a pixel.
fn backdrop(corner: vec2<f32>) -> vec3<f32> {
    return job.sky;
}
