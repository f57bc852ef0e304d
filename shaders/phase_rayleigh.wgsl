// P = 3 / (16 pi) (1 + cos^2 theta), unpolarised.

// P(cos theta) [1/sr].
fn phase_pdf(cos_theta: f32) -> f32 {
    return 3.0 / 16.0 * FRAC_1_PI * (1.0 + cos_theta * cos_theta);
}

// Inversion: the root of mu^3 + 3 mu = 8 xi - 4, by five Newton steps from the secant.
fn phase_sample(xi: f32) -> vec2<f32> {
    let c = 8.0 * xi - 4.0;
    var mu = c * 0.28;
    mu = newton_step(mu, c);
    mu = newton_step(mu, c);
    mu = newton_step(mu, c);
    mu = newton_step(mu, c);
    mu = newton_step(mu, c);
    mu = min(max(mu, -1.0), 1.0);
    return vec2(mu, sqrt(1.0 - mu * mu));
}

// A Newton step towards the root of mu^3 + 3 mu = c.
fn newton_step(mu: f32, c: f32) -> f32 {
    let square = mu * mu;
    return (2.0 * square * mu + c) / (3.0 * (square + 1.0));
}
