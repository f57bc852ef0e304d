// The medium emits.

@group(0) @binding(22) var<storage, read_write> glows: array<Glow>;

// The light that it emits towards the eye along a ray.
fn emitted_by(ray: u32) -> Spectrum {
    return glows[ray].sum;
}
