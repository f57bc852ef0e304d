//! Phase functions: the angular density of scattering, per steradian, of integral 1 over the sphere. `cos_theta` is the
//! cosine between the directions of travel before and after, so `g > 0` scatters forward.
//!
//! To add one: a variant here, its arms in `pdf`, `sample`, `mean_cosine` and `legendre`, and a row in `tests/phase.rs`,
//! whose tests (normalisation, moments, chi-square of the samples, twins in f32) loop over all rows.

use super::{Real, harmonics};
use crate::error::{Result, scene_error};
use std::f64::consts::{FRAC_1_PI, PI};

/// The closed set of phase functions.
#[derive(Debug, Clone, PartialEq)]
pub enum Phase {
    /// P = 1 / (4 pi).
    Isotropic,
    /// P = 3 / (16 pi) (1 + cos^2 theta), unpolarised.
    Rayleigh,
    /// P = (1 - g^2) / (4 pi (1 + g^2 - 2 g cos theta)^(3/2)), |g| < 1 (Henyey and Greenstein 1941).
    HenyeyGreenstein {
        /// The mean cosine.
        g: f64,
    },
    /// Linear in cos theta between given knots, normalised.
    Tabulated(Table),
}

/// A phase function that is linear between knots in cos theta: density and distribution of cos theta at the knots.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    cos_theta: Vec<f32>,
    density: Vec<f32>,
    cumulative: Vec<f32>,
    mean_cosine: f64,
}

impl Phase {
    /// A Henyey-Greenstein phase function; |g| must be below 1.
    pub fn henyey_greenstein(g: f64) -> Result<Self> {
        if !(g.abs() < 1.0) {
            return scene_error(format!("HenyeyGreenstein: g = {g} is not allowed; |g| must be below 1"));
        }
        Ok(Phase::HenyeyGreenstein { g })
    }

    /// A phase function from values (any positive scale) at increasing knots from -1 to 1.
    pub fn tabulated(cos_theta: &[f64], values: &[f64]) -> Result<Self> {
        let name = "TabulatedPhase";
        if cos_theta.len() != values.len() || cos_theta.len() < 2 {
            return scene_error(format!(
                "{name}: {} cos_theta and {} values given; two equally long sequences of at least 2 are needed",
                cos_theta.len(),
                values.len()
            ));
        }
        if let Some(i) = values.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
            return scene_error(format!("{name}: values[{i}] = {} is not finite and non-negative", values[i]));
        }
        if let Some(i) = (1..cos_theta.len()).find(|&i| !(cos_theta[i] > cos_theta[i - 1])) {
            return scene_error(format!("{name}: cos_theta must increase strictly, but does not at index {i}"));
        }
        let (first, last) = (cos_theta[0], cos_theta[cos_theta.len() - 1]);
        if (first + 1.0).abs() > 1e-6 || (last - 1.0).abs() > 1e-6 {
            return scene_error(format!("{name}: cos_theta must run from -1 to 1, but runs from {first} to {last}"));
        }
        let width = |i: usize| cos_theta[i + 1] - cos_theta[i];
        let mut cumulative = vec![0.0];
        let mut moment = 0.0;
        for i in 0..values.len() - 1 {
            let (a, b, c0, w) = (values[i], values[i + 1], cos_theta[i], width(i));
            cumulative.push(cumulative[i] + 0.5 * (a + b) * w);
            moment += w * (0.5 * (a + b) * c0 + w * (a + 2.0 * b) / 6.0);
        }
        let total = cumulative[cumulative.len() - 1];
        if !(total > 0.0 && total.is_finite()) {
            return scene_error(format!("{name}: the values have the integral {total}; it must be positive"));
        }
        let single = |v: &[f64], scale: f64| v.iter().map(|x| (x * scale) as f32).collect::<Vec<_>>();
        Ok(Phase::Tabulated(Table {
            cos_theta: single(cos_theta, 1.0),
            density: single(values, 1.0 / total),
            cumulative: single(&cumulative, 1.0 / total),
            mean_cosine: moment / total,
        }))
    }

    /// Whether light leaves in every direction alike.
    pub fn is_isotropic(&self) -> bool {
        matches!(self, Phase::Isotropic) || matches!(self, Phase::HenyeyGreenstein { g } if *g == 0.0)
    }

    /// g, the mean of cos theta.
    pub fn mean_cosine(&self) -> f64 {
        match self {
            Phase::Isotropic | Phase::Rayleigh => 0.0,
            Phase::HenyeyGreenstein { g } => *g,
            Phase::Tabulated(table) => table.mean_cosine,
        }
    }

    /// The Legendre coefficient p_l = 2 pi * integral of P(cos theta) P_l(cos theta) d cos theta, by which scattering scales
    /// the harmonics of order l: p_0 = 1, p_1 = g, and P = sum of (2l + 1) / (4 pi) p_l P_l.
    pub fn legendre(&self, l: usize) -> f64 {
        match self {
            Phase::Isotropic => f64::from(l == 0),
            Phase::Rayleigh => [1.0, 0.0, 0.1].get(l).copied().unwrap_or(0.0),
            Phase::HenyeyGreenstein { g } => g.powi(l as i32),
            Phase::Tabulated(table) => table.legendre(l),
        }
    }

    /// P(cos theta) [1/sr].
    #[inline(always)]
    pub fn pdf<R: Real>(&self, cos_theta: R) -> R {
        match self {
            Phase::Isotropic => R::of(0.25 * FRAC_1_PI),
            Phase::Rayleigh => R::of(3.0 / 16.0 * FRAC_1_PI) * (R::of(1.0) + cos_theta * cos_theta),
            Phase::HenyeyGreenstein { g } => henyey_greenstein_pdf(*g, cos_theta),
            Phase::Tabulated(table) => table.pdf(cos_theta),
        }
    }

    /// (cos theta, sin theta) from a uniform number.
    #[inline(always)]
    pub fn sample<R: Real>(&self, xi: R) -> (R, R) {
        match self {
            Phase::Isotropic => with_sine(R::of(2.0) * (R::of(1.0) - xi)),
            Phase::Rayleigh => rayleigh_sample(xi),
            Phase::HenyeyGreenstein { g } => henyey_greenstein_sample(*g, xi),
            Phase::Tabulated(table) => with_sine(R::of(1.0) - table.sample(xi)),
        }
    }
}

impl Phase {
    /// [`Phase::sample`] in `N` lanes: (cos theta, sin theta) of each. The kind is looked at once, so that the loops are free
    /// of branches.
    #[inline(always)]
    pub fn sample_lanes<const N: usize>(&self, xi: &[f32; N]) -> ([f32; N], [f32; N]) {
        match self {
            Phase::Isotropic => pairs(xi, |xi| with_sine(2.0 * (1.0 - xi))),
            Phase::Rayleigh => pairs(xi, rayleigh_sample),
            Phase::HenyeyGreenstein { g } => pairs(xi, |xi| henyey_greenstein_sample(*g, xi)),
            Phase::Tabulated(table) => pairs(xi, |xi| with_sine(1.0 - table.sample(xi))),
        }
    }

    /// [`Phase::pdf`] in `N` lanes.
    #[inline(always)]
    pub fn pdf_lanes<const N: usize>(&self, cos_theta: &[f32; N]) -> [f32; N] {
        match self {
            Phase::Isotropic => [0.25 * std::f32::consts::FRAC_1_PI; N],
            Phase::Rayleigh => each(cos_theta, |c| Phase::Rayleigh.pdf(c)),
            Phase::HenyeyGreenstein { g } => each(cos_theta, |c| henyey_greenstein_pdf(*g, c)),
            Phase::Tabulated(table) => each(cos_theta, |c| table.pdf(c)),
        }
    }
}

#[inline(always)]
fn each<const N: usize>(x: &[f32; N], f: impl Fn(f32) -> f32) -> [f32; N] {
    let mut out = [0.0; N];
    for i in 0..N {
        out[i] = f(x[i]);
    }
    out
}

#[inline(always)]
fn pairs<const N: usize>(x: &[f32; N], f: impl Fn(f32) -> (f32, f32)) -> ([f32; N], [f32; N]) {
    let mut out = ([0.0; N], [0.0; N]);
    for i in 0..N {
        (out.0[i], out.1[i]) = f(x[i]);
    }
    out
}

/// (cos theta, sin theta) from 1 - cos theta, which keeps its precision in a forward peak.
#[inline(always)]
fn with_sine<R: Real>(one_minus_cos: R) -> (R, R) {
    let v = one_minus_cos;
    (R::of(1.0) - v, (v * (R::of(2.0) - v)).max(R::of(0.0)).sqrt())
}

/// The denominator 1 + g^2 - 2 g cos theta is written (1 - g)^2 + 2 g (1 - cos theta), for it cancels at g near 1.
#[inline(always)]
fn henyey_greenstein_pdf<R: Real>(g: f64, cos_theta: R) -> R {
    let (near, edge) = if g >= 0.0 { (1.0 - g, R::of(1.0) - cos_theta) } else { (1.0 + g, R::of(1.0) + cos_theta) };
    let d = R::of(near * near) + R::of(2.0 * g.abs()) * edge.max(R::of(0.0));
    R::of(0.25 * FRAC_1_PI * (1.0 - g * g)) / (d * d.sqrt())
}

/// Inversion of the distribution, solved for 1 - cos theta = 2 (1 - g)^2 (1 - xi) (1 + g xi) / (1 - g + 2 g xi)^2: no
/// division by g and no cancellation, hence right for every |g| < 1.
#[inline(always)]
fn henyey_greenstein_sample<R: Real>(g: f64, xi: R) -> (R, R) {
    let one = R::of(1.0);
    // For g < 0 the mirrored function is sampled, for 1 - cos theta would lose the backward peak.
    let q = g.abs();
    let (xi, rest) = if g < 0.0 { (one - xi, xi) } else { (xi, one - xi) };
    let b = R::of(1.0 - q) + R::of(2.0 * q) * xi;
    let v = R::of(2.0 * (1.0 - q) * (1.0 - q)) * rest * (one + R::of(q) * xi) / (b * b);
    let (cos_theta, sin_theta) = with_sine(v);
    (if g < 0.0 { -cos_theta } else { cos_theta }, sin_theta)
}

/// Inversion: the root of mu^3 + 3 mu = 8 xi - 4, by five Newton steps from the secant.
#[inline(always)]
fn rayleigh_sample<R: Real>(xi: R) -> (R, R) {
    let c = R::of(8.0) * xi - R::of(4.0);
    let mut mu = c * R::of(0.28);
    for _ in 0..5 {
        let square = mu * mu;
        mu = (R::of(2.0) * square * mu + c) / (R::of(3.0) * (square + R::of(1.0)));
    }
    let mu = mu.max(R::of(-1.0)).min(R::of(1.0));
    (mu, (R::of(1.0) - mu * mu).sqrt())
}

impl Table {
    /// Knots, densities and distribution, one after the other, and the number of each.
    pub fn flat(&self) -> (Vec<f32>, usize) {
        ([&self.cos_theta[..], &self.density, &self.cumulative].concat(), self.cos_theta.len())
    }

    #[inline(always)]
    fn pdf<R: Real>(&self, cos_theta: R) -> R {
        let k = segment(&self.cos_theta, cos_theta);
        let next = k + R::of(1.0);
        let (c0, c1) = (k.lookup(&self.cos_theta), next.lookup(&self.cos_theta));
        let (p0, p1) = (k.lookup(&self.density), next.lookup(&self.density));
        let t = ((cos_theta - c0) / (c1 - c0)).max(R::of(0.0)).min(R::of(1.0));
        R::of(0.5 / PI) * (p0 + (p1 - p0) * t)
    }

    /// A Gauss-Legendre rule in each segment, exact for its polynomial of degree l + 1; by the rule's own integral of the
    /// rounded density, so that p_0 is exactly 1.
    fn legendre(&self, l: usize) -> f64 {
        let (mut moment, mut total) = (0.0, 0.0);
        for (node, weight) in harmonics::gauss_legendre((l + 3) / 2) {
            let t = 0.5 * (node + 1.0);
            for i in 0..self.density.len() - 1 {
                let between = |v: &[f32]| f64::from(v[i]) * (1.0 - t) + f64::from(v[i + 1]) * t;
                let width = f64::from(self.cos_theta[i + 1]) - f64::from(self.cos_theta[i]);
                let mass = weight * width * between(&self.density);
                moment += mass * harmonics::legendre(l, between(&self.cos_theta));
                total += mass;
            }
        }
        moment / total
    }

    /// Inversion of the quadratic distribution within the segment that holds `xi`.
    #[inline(always)]
    fn sample<R: Real>(&self, xi: R) -> R {
        let k = segment(&self.cumulative, xi);
        let next = k + R::of(1.0);
        let (c0, c1) = (k.lookup(&self.cos_theta), next.lookup(&self.cos_theta));
        let (p0, p1) = (k.lookup(&self.density), next.lookup(&self.density));
        let rest = (xi - k.lookup(&self.cumulative)).max(R::of(0.0));
        let slope = (p1 - p0) / (c1 - c0);
        let root = (p0 * p0 + R::of(2.0) * slope * rest).max(R::of(0.0)).sqrt();
        let step = R::of(2.0) * rest / (p0 + root).max(R::of(1e-30));
        (c0 + step).min(c1)
    }
}

/// The index k <= len - 2 of the segment [table[k], table[k + 1]) that holds `x`, by bisection.
#[inline(always)]
fn segment<R: Real>(table: &[f32], x: R) -> R {
    let last = table.len() - 2;
    let mut k = R::of(0.0);
    let mut step = (last + 1).next_power_of_two();
    while step > 0 {
        let next = (k + R::of(step as f64)).min(R::of(last as f64));
        k = R::select(x.lt(next.lookup(table)), k, next);
        step /= 2;
    }
    k
}
