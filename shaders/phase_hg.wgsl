// P = (1 - g^2) / (4 pi (1 + g^2 - 2 g cos theta)^(3/2)), |g| < 1 (Henyey and Greenstein 1941). What depends on g comes
// in as numbers of their own, for 1 - |g| in single precision would be wrong near 1.

// g, the mean cosine.
override HG_G: f32;
// 1 - |g|.
override HG_NEAR: f32;
// (1 - |g|)^2.
override HG_NEAR_SQUARED: f32;
// (1 - g^2) / (4 pi).
override HG_SCALE: f32;

// P(cos theta) [1/sr]. The denominator 1 + g^2 - 2 g cos theta is written (1 - g)^2 + 2 g (1 - cos theta), for it
// cancels at g near 1.
fn phase_pdf(cos_theta: f32) -> f32 {
    let edge = select(1.0 - cos_theta, 1.0 + cos_theta, HG_G < 0.0);
    let d = HG_NEAR_SQUARED + 2.0 * abs(HG_G) * max(edge, 0.0);
    return HG_SCALE / (d * sqrt(d));
}

// Inversion of the distribution, solved for 1 - cos theta = 2 (1 - g)^2 (1 - xi) (1 + g xi) / (1 - g + 2 g xi)^2: no
// division by g and no cancellation, hence right for every |g| < 1.
fn phase_sample(xi: f32) -> vec2<f32> {
    // For g < 0 the mirrored function is sampled, for 1 - cos theta would lose the backward peak.
    let q = abs(HG_G);
    let mirrored = HG_G < 0.0;
    let x = select(xi, 1.0 - xi, mirrored);
    let rest = select(1.0 - xi, xi, mirrored);
    let b = HG_NEAR + 2.0 * q * x;
    let v = 2.0 * HG_NEAR_SQUARED * rest * (1.0 + q * x) / (b * b);
    let angle = with_sine(v);
    return vec2(select(angle.x, -angle.x, mirrored), angle.y);
}
