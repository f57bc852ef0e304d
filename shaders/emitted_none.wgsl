// The medium emits nothing.

// The light that it emits towards the eye along a ray.
fn emitted_by(ray: u32) -> Spectrum {
    return Spectrum(0.0);
}
