// P = (1 - g^2) / (4 pi (1 + g^2 - 2 g cos theta)^(3/2)), |g| < 1 (Henyey and Greenstein 1941). What depends on g comes
// in as numbers of their own, for 1 - |g| in single precision would be wrong near 1.

// P(cos theta) [1/sr]. The denominator 1 + g^2 - 2 g cos theta is written (1 - g)^2 + 2 g (1 - cos theta), for it
// cancels at g near 1.
fn phase_pdf(cos_theta: f32) -> f32 {
    let edge = select(1.0 - cos_theta, 1.0 + cos_theta, scene.hg.x < 0.0);
    let d = scene.hg.z + 2.0 * abs(scene.hg.x) * max(edge, 0.0);
    return scene.hg.w / (d * sqrt(d));
}

// Inversion of the distribution, solved for 1 - cos theta = 2 (1 - g)^2 (1 - xi) (1 + g xi) / (1 - g + 2 g xi)^2: no
// division by g and no cancellation, hence right for every |g| < 1.
fn phase_sample(xi: f32) -> vec2<f32> {
    // For g < 0 the mirrored function is sampled, for 1 - cos theta would lose the backward peak.
    let q = abs(scene.hg.x);
    let mirrored = scene.hg.x < 0.0;
    let x = select(xi, 1.0 - xi, mirrored);
    let rest = select(1.0 - xi, xi, mirrored);
    let b = scene.hg.y + 2.0 * q * x;
    let v = 2.0 * scene.hg.z * rest * (1.0 + q * x) / (b * b);
    let angle = with_sine(v);
    return vec2(select(angle.x, -angle.x, mirrored), angle.y);
}
