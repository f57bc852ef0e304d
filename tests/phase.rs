//! What holds for every phase function: one row each in `all`, and every test loops over the rows.

use mcrt::physics::Phase;
use mcrt::physics::harmonics::legendre;
use std::f64::consts::PI;

fn all() -> Vec<(&'static str, Phase)> {
    let hg = |g: f64| Phase::henyey_greenstein(g).expect("valid");
    let table = Phase::tabulated(&[-1.0, -0.5, 0.1, 0.7, 0.95, 1.0], &[0.3, 0.1, 0.0, 0.4, 2.0, 9.0]).expect("valid");
    vec![
        ("isotropic", Phase::Isotropic),
        ("rayleigh", Phase::Rayleigh),
        ("hg 0", hg(0.0)),
        ("hg 1e-6", hg(1e-6)),
        ("hg -1e-4", hg(-1e-4)),
        ("hg .3", hg(0.3)),
        ("hg -.5", hg(-0.5)),
        ("hg .9", hg(0.9)),
        ("hg .99", hg(0.99)),
        ("hg -.99", hg(-0.99)),
        ("tabulated", table),
    ]
}

/// The integral of f over cos theta, fine at both ends where peaks are, and split at the table's knots.
fn integral(f: impl Fn(f64) -> f64) -> f64 {
    let mut edges = vec![-1.0, -0.5, 0.0, 0.1, 0.7, 0.95, 1.0];
    for i in 1..40 {
        let near = 0.5f64.powi(i);
        edges.extend([1.0 - near, near - 1.0]);
    }
    edges.sort_by(f64::total_cmp);
    let mut sum = 0.0;
    for pair in edges.windows(2) {
        let m = 64;
        let step = (pair[1] - pair[0]) / f64::from(m);
        for i in 0..m {
            let a = pair[0] + step * f64::from(i);
            sum += step / 6.0 * (f(a) + 4.0 * f(a + 0.5 * step) + f(a + step));
        }
    }
    sum
}

/// Evenly spread uniform numbers.
fn spread(n: u32) -> impl Iterator<Item = f64> {
    (0..n).map(move |i| (f64::from(i) + 0.5) / f64::from(n))
}

#[test]
fn every_phase_function_is_normalised() {
    for (name, phase) in all() {
        let total = 2.0 * PI * integral(|c| phase.pdf(c));
        assert!((total - 1.0).abs() < 1e-6, "{name}: {total}");
    }
}

#[test]
fn mean_cosine_is_that_of_the_density_and_of_the_samples() {
    for (name, phase) in all() {
        let of_density = 2.0 * PI * integral(|c| c * phase.pdf(c));
        let n = 200_000;
        let of_samples = spread(n).map(|xi| phase.sample(xi).0).sum::<f64>() / f64::from(n);
        let g = phase.mean_cosine();
        assert!((of_density - g).abs() < 1e-6, "{name}: {of_density} for {g}");
        assert!((of_samples - g).abs() < 2e-4, "{name}: {of_samples} for {g}");
    }
}

#[test]
fn legendre_coefficients_are_those_of_the_density() {
    for (name, phase) in all() {
        assert_eq!(phase.legendre(0), 1.0, "{name}");
        for l in 1..=12 {
            let of_density = 2.0 * PI * integral(|c| legendre(l, c) * phase.pdf(c));
            let p = phase.legendre(l);
            assert!((of_density - p).abs() < 1e-6, "{name}, l = {l}: {of_density} for {p}");
        }
        assert!((phase.legendre(1) - phase.mean_cosine()).abs() < 1e-7, "{name}");
    }
}

#[test]
fn samples_follow_the_density() {
    // Bins of equal probability cannot hide a peak: each sample's cumulative density is its own uniform number.
    for (name, phase) in all() {
        for xi in spread(23) {
            let (cos_theta, sin_theta) = phase.sample(xi);
            let below = 2.0 * PI * integral(|c| if c < cos_theta { phase.pdf(c) } else { 0.0 });
            assert!((below - xi).abs() < 2e-3, "{name}: P(cos < {cos_theta}) = {below} for xi = {xi}");
            assert!((cos_theta * cos_theta + sin_theta * sin_theta - 1.0).abs() < 1e-9, "{name}");
        }
    }
}

#[test]
fn chi_square_of_the_samples_in_f32() {
    // 64 bins of equal probability, 2^18 stratified-free pseudo-random samples each. False alarm 1e-6 per row.
    for (name, phase) in all() {
        let edges: Vec<f64> = (1..64).map(|i| phase.sample(f64::from(i) / 64.0).0).collect();
        let n = 1u32 << 18;
        let mut counts = [0u32; 64];
        let mut draws = mcrt::physics::rng::Draws::new([7, 0], 0, 0);
        for _ in 0..n / 4 {
            for word in draws.next4() {
                let cos_theta: f32 = phase.sample(mcrt::physics::rng::uniform(word)).0;
                counts[edges.partition_point(|&e| e < f64::from(cos_theta))] += 1;
            }
        }
        let expected = f64::from(n) / 64.0;
        let chi2: f64 = counts.iter().map(|&c| (f64::from(c) - expected).powi(2) / expected).sum();
        assert!(chi2 < 133.0, "{name}: chi-square {chi2} with 63 degrees of freedom");
    }
}

#[test]
fn f32_is_a_twin_of_f64() {
    for (name, phase) in all() {
        for xi in spread(4096) {
            let exact = phase.sample(f64::from(xi as f32)).0;
            let (cos_theta, _) = phase.sample(xi as f32);
            assert!((f64::from(cos_theta) - exact).abs() < 1e-4, "{name}: {cos_theta} for {exact}");
        }
    }
}

#[test]
fn density_in_f32_is_close_to_f64() {
    for (name, phase) in all() {
        for u in spread(1000) {
            let cos_theta = (2.0 * u - 1.0) as f32;
            let exact = phase.pdf(f64::from(cos_theta));
            let error = (f64::from(phase.pdf(cos_theta)) - exact).abs();
            // g = .99: 1 - g^2 is the difference of near numbers, taken in f64; what is left is rounding of cos theta.
            assert!(error < 1e-4 * exact + 1e-7, "{name} at {cos_theta}: {error}");
        }
    }
}

#[test]
fn tiny_g_is_no_worse_than_none() {
    for g in [1e-6, -1e-6, 1e-4, -1e-4] {
        let phase = Phase::henyey_greenstein(g).expect("valid");
        for xi in spread(1000) {
            let isotropic = Phase::Isotropic.sample(xi as f32).0;
            let cos_theta: f32 = phase.sample(xi as f32).0;
            assert!((cos_theta - isotropic).abs() < 2.0 * g.abs() as f32 + 4e-7, "g = {g}, xi = {xi}");
        }
    }
}

#[test]
fn bad_phase_functions_are_refused() {
    for g in [1.0, -1.0, f64::NAN, f64::INFINITY, 2.0] {
        assert!(Phase::henyey_greenstein(g).is_err(), "g = {g}");
    }
    for (cosines, values) in [
        (vec![-1.0, 1.0], vec![0.0, 0.0]),
        (vec![-1.0, 1.0], vec![1.0, f64::NAN]),
        (vec![-1.0, 1.0], vec![1.0, -1.0]),
        (vec![-0.9, 1.0], vec![1.0, 1.0]),
        (vec![-1.0, 0.0, 0.0, 1.0], vec![1.0; 4]),
        (vec![-1.0, 1.0], vec![1.0]),
        (vec![0.0], vec![1.0]),
    ] {
        assert!(Phase::tabulated(&cosines, &values).is_err(), "{cosines:?} {values:?}");
    }
}
