// Adds what of the light would scatter towards the eye.
fn deposit_angular(first: u32, voxel: u32, p: vec3<f32>, d: vec3<f32>, units: Spectrum, xi: f32) {
    let eye = to_eye(scene.eye, p, scene.h);
    let seen = phase_pdf(clamp(eye.x * d.x + eye.y * d.y + eye.z * d.z, -1.0, 1.0));
    for (var c = 0u; c < CHANNELS; c++) {
        add_units(first + voxel * CHANNELS + c, channel(units, c) * seen, xi);
    }
}
