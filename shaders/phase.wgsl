// What phase functions share. One of the files phase_*.wgsl gives phase_pdf(cos_theta), P(cos theta) [1/sr], and
// phase_sample(xi), (cos theta, sin theta) from a uniform number; cos_theta is the cosine between the directions of
// travel before and after.

const FRAC_1_PI = 0.31830988618379067;

// (cos theta, sin theta) from 1 - cos theta, which keeps its precision in a forward peak.
fn with_sine(one_minus_cos: f32) -> vec2<f32> {
    let v = one_minus_cos;
    return vec2(1.0 - v, sqrt(max(v * (2.0 - v), 0.0)));
}
