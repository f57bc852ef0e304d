//! Real spherical harmonics Y_lm of a direction (x, y, z), orthonormal over the sphere, l = 0 ..= order, m = -l ..= l, at
//! the index l (l + 1) + m. With theta from +z, phi from +x, and no Condon-Shortley sign (Y_11 = sqrt(3 / (4 pi)) x):
//!
//! ```text
//! Y_lm = q_lm(z) * Re (x + i y)^m,  m >= 0       (x + i y)^m = sin^m theta (cos m phi + i sin m phi)
//! Y_lm = q_l|m|(z) * Im (x + i y)^|m|,  m < 0    q_lm = sqrt((2 - delta_m0) (2l + 1) / (4 pi) * (l - m)! / (l + m)!)
//!                                                       * |P_l^m(z)| / sin^m theta, a polynomial
//! q_mm^2 = (2 - delta_m0) / (4 pi) * (3 / 2) (5 / 4) ... ((2m + 1) / (2m))
//! q_lm = a_lm z q_(l-1)m - b_lm q_(l-2)m         a_lm^2 = (4 l^2 - 1) / (l^2 - m^2),  b_lm = a_lm / a_(l-1)m
//! ```
//!
//! Hence neither trigonometry nor a division by sin theta (Sloan, *Efficient spherical harmonic evaluation*, JCGT 2(2), 2013).
//!
//! They diagonalise scattering. With p_l of [`Phase::legendre`](super::Phase::legendre), the addition theorem
//!
//! ```text
//! sum over m of Y_lm(a) Y_lm(b) = (2l + 1) / (4 pi) P_l(a . b)
//! ```
//!
//! gives P(w' . w) = sum of p_l Y_lm(w') Y_lm(w), so that the radiance L = sum of L_lm Y_lm scatters into
//!
//! ```text
//! integral of P(w' . w) L(w') dw' = sum of p_l L_lm Y_lm(w),   L_lm = integral of L Y_lm
//! ```
//!
//! (Sloan, Kautz and Snyder, *Precomputed radiance transfer*, SIGGRAPH 2002, rule for a circularly symmetric kernel h:
//! sqrt(4 pi / (2l + 1)) h_l0 L_lm, and h_l0 = sqrt((2l + 1) / (4 pi)) p_l).

use super::Real;
use std::f64::consts::PI;

/// The largest order that [`evaluate`] knows.
pub const MAX_ORDER: usize = 8;

/// The number of harmonics of l <= `order`: (order + 1)^2.
pub const fn count(order: usize) -> usize {
    (order + 1) * (order + 1)
}

/// The largest |Y_lm| over all directions and m, sqrt((2l + 1) / (4 pi)): Y_l0 at the poles, by the addition theorem.
pub fn bound(l: usize) -> f64 {
    ((2 * l + 1) as f64 / (4.0 * PI)).sqrt()
}

/// q_mm, and (a, b) of the step to l = m + 1 + k at `step[m][k]`.
struct Recurrence {
    first: [f64; MAX_ORDER + 1],
    step: [[(f64, f64); MAX_ORDER]; MAX_ORDER + 1],
}

// A constant, not a static, so that a constant order folds its entries into the code of any crate.
const RECURRENCE: &Recurrence = &recurrence();

const fn recurrence() -> Recurrence {
    let mut table = Recurrence { first: [0.0; MAX_ORDER + 1], step: [[(0.0, 0.0); MAX_ORDER]; MAX_ORDER + 1] };
    let mut square = 0.25 / PI;
    let mut m = 0;
    while m <= MAX_ORDER {
        table.first[m] = square_root(square);
        square *= (2 * m + 3) as f64 / (2 * m + 2) as f64;
        if m == 0 {
            square *= 2.0;
        }
        let mut before = 0.0;
        let mut l = m + 1;
        while l <= MAX_ORDER {
            let a = square_root((4 * l * l - 1) as f64 / (l * l - m * m) as f64);
            table.step[m][l - m - 1] = (a, if l == m + 1 { 0.0 } else { a / before });
            before = a;
            l += 1;
        }
        m += 1;
    }
    table
}

/// Newton's method from above, for `f64::sqrt` is not const.
const fn square_root(x: f64) -> f64 {
    let mut root = if x > 1.0 { x } else { 1.0 };
    loop {
        let next = 0.5 * (root + x / root);
        if next >= root {
            return root;
        }
        root = next;
    }
}

/// Writes all Y_lm(d) of l <= `order` to the first [`count`] entries of `out`. `d` must be of unit length; `order` beyond
/// [`MAX_ORDER`] or a shorter `out` panics. Nothing branches on `d`.
#[inline(always)]
pub fn evaluate<R: Real>([x, y, z]: [R; 3], order: usize, out: &mut [R]) {
    assert!(order <= MAX_ORDER, "order {order} is beyond {MAX_ORDER}");
    let out = &mut out[..count(order)];
    let (mut re, mut im) = (R::of(1.0), R::of(0.0));
    for m in 0..=order {
        let (mut q, mut before) = (R::of(RECURRENCE.first[m]), R::of(0.0));
        for l in m..=order {
            // At m = 0 both are one place, and the later stays.
            out[l * (l + 1) - m] = q * im;
            out[l * (l + 1) + m] = q * re;
            if l < order {
                let (a, b) = RECURRENCE.step[m][l - m];
                (q, before) = (R::of(a) * z * q - R::of(b) * before, q);
            }
        }
        (re, im) = (x * re - y * im, x * im + y * re);
    }
}

/// The Legendre polynomial P_l(x).
pub fn legendre(l: usize, x: f64) -> f64 {
    legendre_pair(l, x).0
}

/// (P_l, P_(l-1)), by (k + 1) P_(k+1) = (2k + 1) x P_k - k P_(k-1).
fn legendre_pair(l: usize, x: f64) -> (f64, f64) {
    let (mut p, mut before) = (1.0, 0.0);
    for k in 0..l {
        let k = k as f64;
        (p, before) = (((2.0 * k + 1.0) * x * p - k * before) / (k + 1.0), p);
    }
    (p, before)
}

/// (node, weight) of the `n`-point Gauss-Legendre rule on [-1, 1], exact up to degree 2n - 1: the roots of P_n, by Newton's
/// method (Press et al., *Numerical recipes*, 3rd edition, 4.6).
pub fn gauss_legendre(n: usize) -> impl Iterator<Item = (f64, f64)> {
    (0..n).map(move |i| {
        let slope = |x: f64, (p, before): (f64, f64)| n as f64 * (x * p - before) / (x * x - 1.0);
        let mut x = (PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
        for _ in 0..6 {
            let pair = legendre_pair(n, x);
            x -= pair.0 / slope(x, pair);
        }
        let slope = slope(x, legendre_pair(n, x));
        (x, 2.0 / ((1.0 - x * x) * slope * slope))
    })
}
