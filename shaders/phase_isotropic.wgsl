// P = 1 / (4 pi).

// P(cos theta) [1/sr].
fn phase_pdf(cos_theta: f32) -> f32 {
    return 0.25 * FRAC_1_PI;
}

// (cos theta, sin theta) from a uniform number.
fn phase_sample(xi: f32) -> vec2<f32> {
    return with_sine(2.0 * (1.0 - xi));
}
