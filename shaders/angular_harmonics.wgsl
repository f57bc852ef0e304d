// The order of the spherical harmonics.
override ORDER: u32 = 0u;

// Adds the spherical harmonics of the light's direction.
fn deposit_angular(first: u32, voxel: u32, p: vec3<f32>, d: vec3<f32>, units: Spectrum, xi: f32) {
    let base = first + voxel * (ORDER + 1u) * (ORDER + 1u) * CHANNELS;
    for (var h = first_harmonic(); h.m <= ORDER; h = next_harmonic(h, d, ORDER)) {
        let at = harmonic_index(h);
        let y = harmonic_pair(h);
        for (var c = 0u; c < CHANNELS; c++) {
            if h.m > 0u {
                add_units(base + at.x * CHANNELS + c, channel(units, c) * y.x, xi);
            }
            add_units(base + at.y * CHANNELS + c, channel(units, c) * y.y, xi);
        }
    }
}
