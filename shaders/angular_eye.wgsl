// The unit vector from a point towards the eye.
fn to_eye(p: vec3<f32>) -> vec3<f32> {
    if scene.eye.w == 0.0 {
        return scene.eye.xyz;
    }
    let r = (scene.eye.xyz - p) * scene.h;
    return r / max(sqrt(r.x * r.x + r.y * r.y + r.z * r.z), 1e-30);
}

// Adds what of the light would scatter towards the eye.
fn deposit_angular(first: u32, voxel: u32, p: vec3<f32>, d: vec3<f32>, units: Spectrum, xi: f32) {
    let eye = to_eye(p);
    let seen = phase_pdf(clamp(eye.x * d.x + eye.y * d.y + eye.z * d.z, -1.0, 1.0));
    for (var c = 0u; c < CHANNELS; c++) {
        add_units(first + voxel * CHANNELS + c, channel(units, c) * seen, xi);
    }
}
