//! Spherical harmonics against their definition, and what scattering does to them.

use mcrt::physics::harmonics::{MAX_ORDER, bound, count, evaluate, gauss_legendre, legendre};
use mcrt::physics::{Phase, Real, rng};
use std::f64::consts::{PI, TAU};

const COUNT: usize = count(MAX_ORDER);

fn all<R: Real>(d: [R; 3]) -> [R; COUNT] {
    let mut y = [R::of(f64::NAN); COUNT];
    evaluate(d, MAX_ORDER, &mut y);
    y
}

fn direction(z: f64, phi: f64) -> [f64; 3] {
    let s = (1.0 - z * z).sqrt();
    [s * phi.cos(), s * phi.sin(), z]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| a[i] * b[i]).sum()
}

/// (direction, solid angle), exact for polynomials of degree 2n - 1.
fn sphere(n: usize) -> Vec<([f64; 3], f64)> {
    let turn = TAU / (2 * n) as f64;
    gauss_legendre(n).flat_map(|(z, w)| (0..2 * n).map(move |i| (direction(z, turn * i as f64), w * turn))).collect()
}

/// The poles, their neighbourhoods, the other axes, and random directions.
fn directions() -> Vec<[f64; 3]> {
    let mut list = vec![[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [-0.0, -0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]];
    list.extend([1e-3, 1e-8, 1e-20].map(|s: f64| [0.6 * s, -0.8 * s, (1.0 - s * s).sqrt()]));
    let mut draws = rng::Draws::new([11, 0], 0, 0);
    for _ in 0..100 {
        let [a, b, c, d] = draws.next4().map(rng::uniform64);
        list.extend([direction(2.0 * a - 1.0, TAU * b), direction(2.0 * c - 1.0, TAU * d)]);
    }
    list
}

#[test]
fn gauss_legendre_is_exact_up_to_degree_2n_minus_1_and_no_further() {
    for n in 1..=40 {
        let moment = |k: i32| gauss_legendre(n).map(|(x, w)| w * x.powi(k)).sum::<f64>();
        for k in 0..2 * n as i32 {
            let exact = if k % 2 == 0 { 2.0 / f64::from(k + 1) } else { 0.0 };
            assert!((moment(k) - exact).abs() < 1e-13, "n = {n}, degree {k}: {}", moment(k));
        }
        // Its error at degree 2n is (2/(2n + 1)) (2^n n!^2 / (2n)!)^2, some 4^-n.
        assert!(n > 10 || (moment(2 * n as i32) - 2.0 / (2 * n + 1) as f64).abs() > 1e-8, "n = {n}");
    }
}

#[test]
fn legendre_polynomials_have_their_closed_form() {
    for i in -10..=10 {
        let x = f64::from(i) / 10.0;
        let square = x * x;
        let p5 = x * (63.0 * square * square - 70.0 * square + 15.0) / 8.0;
        let p6 = (231.0 * square.powi(3) - 315.0 * square.powi(2) + 105.0 * square - 5.0) / 16.0;
        for (l, exact) in [(0, 1.0), (1, x), (2, 1.5 * square - 0.5), (5, p5), (6, p6)] {
            assert!((legendre(l, x) - exact).abs() < 1e-14, "P_{l}({x})");
        }
    }
}

#[test]
fn first_harmonics_have_their_closed_form() {
    for [x, y, z] in directions() {
        let (c0, c1, c2) = ((0.25 / PI).sqrt(), (0.75 / PI).sqrt(), (3.75 / PI).sqrt());
        let exact = [
            c0,
            c1 * y,
            c1 * z,
            c1 * x,
            c2 * x * y,
            c2 * y * z,
            c2 * (3.0 * z * z - 1.0) / 12f64.sqrt(),
            c2 * x * z,
            c2 * (x * x - y * y) / 2.0,
        ];
        let found = all([x, y, z]);
        for i in 0..exact.len() {
            assert!((found[i] - exact[i]).abs() < 1e-14, "Y[{i}]({x}, {y}, {z}): {} for {}", found[i], exact[i]);
        }
    }
}

#[test]
fn azimuth_enters_as_the_cosine_and_sine_of_m_phi() {
    // With orthonormality, and positive values beside the pole, this defines every Y_lm.
    let beside = all(direction(0.9999, 0.0));
    for (z, phi) in [(0.3, 0.1), (-0.7, 2.0), (0.95, 4.0), (0.0, 5.9)] {
        let (at_zero, found) = (all(direction(z, 0.0)), all(direction(z, phi)));
        for l in 0..=MAX_ORDER {
            for m in 0..=l {
                let (place, turned) = (l * (l + 1), m as f64 * phi);
                assert!(beside[place + m] > 0.0, "l = {l}, m = {m}");
                let even = found[place + m] - at_zero[place + m] * turned.cos();
                assert!(even.abs() < 1e-14, "l = {l}, m = {m}: {even}");
                if m > 0 {
                    let odd = found[place - m] - at_zero[place + m] * turned.sin();
                    assert!(odd.abs() < 1e-14, "l = {l}, m = -{m}: {odd}");
                }
            }
        }
    }
}

#[test]
fn harmonics_are_orthonormal() {
    let mut product = vec![[0.0; COUNT]; COUNT];
    for (d, weight) in sphere(MAX_ORDER + 1) {
        let y = all(d);
        for i in 0..COUNT {
            for j in 0..COUNT {
                product[i][j] += weight * y[i] * y[j];
            }
        }
    }
    for i in 0..COUNT {
        for j in 0..COUNT {
            let exact = f64::from(i == j);
            assert!((product[i][j] - exact).abs() < 1e-12, "({i}, {j}): {}", product[i][j]);
        }
    }
}

#[test]
fn addition_theorem_holds_for_every_pair_of_directions() {
    let list: Vec<_> = directions().into_iter().map(|d| (d, all(d))).collect();
    for (a, of_a) in &list {
        for (b, of_b) in &list {
            for l in 0..=MAX_ORDER {
                let sum: f64 = (l * l..count(l)).map(|i| of_a[i] * of_b[i]).sum();
                let exact = (2 * l + 1) as f64 / (4.0 * PI) * legendre(l, dot(*a, *b));
                assert!((sum - exact).abs() < 1e-13, "l = {l}, {a:?}, {b:?}: {sum} for {exact}");
            }
        }
    }
}

#[test]
fn bound_holds_and_is_reached_at_the_poles() {
    let list: Vec<_> = directions().into_iter().map(all).collect();
    for l in 0..=MAX_ORDER {
        let largest = list.iter().flat_map(|y| &y[l * l..count(l)]).fold(0.0, |m: f64, y| m.max(y.abs()));
        assert!((largest / bound(l) - 1.0).abs() < 1e-14, "l = {l}: {largest}");
    }
}

#[test]
fn f32_is_a_twin_of_f64() {
    for exact in directions() {
        let d = exact.map(|c| c as f32);
        let (found, exact) = (all(d), all(d.map(f64::from)));
        for l in 0..=MAX_ORDER {
            for k in l * l..count(l) {
                let error = (f64::from(found[k]) - exact[k]).abs();
                assert!(error < 1e-6 * bound(l), "Y[{k}]({d:?}): {error}");
            }
        }
    }
}

#[test]
fn lower_orders_are_the_first_of_higher_ones() {
    for d in directions() {
        let full = all(d);
        for order in 0..MAX_ORDER {
            let mut out = [f64::NAN; COUNT];
            evaluate(d, order, &mut out);
            assert_eq!(out[..count(order)], full[..count(order)], "order {order}");
            assert!(out[count(order)..].iter().all(|y| y.is_nan()), "order {order} wrote beyond its harmonics");
        }
    }
}

#[test]
#[should_panic(expected = "order 9 is beyond 8")]
fn orders_beyond_the_largest_are_refused() {
    evaluate([0.0, 0.0, 1.0], MAX_ORDER + 1, &mut [0.0; 100]);
}

#[test]
fn scattering_scales_each_order_by_its_legendre_coefficient() {
    let mut draws = rng::Draws::new([5, 0], 0, 0);
    let coefficients: [f64; COUNT] = std::array::from_fn(|_| 2.0 * rng::uniform64(draws.next4()[0]) - 1.0);
    // Exact up to degree 77, hence beside L up to l = 69 of P, where p_l = .6^l is 5e-16.
    let incident: Vec<_> = sphere(39)
        .into_iter()
        .map(|(d, weight)| (d, weight * all(d).iter().zip(coefficients).map(|(y, c)| y * c).sum::<f64>()))
        .collect();
    for phase in [Phase::HenyeyGreenstein { g: 0.6 }, Phase::HenyeyGreenstein { g: -0.3 }, Phase::Rayleigh] {
        for w in directions().into_iter().step_by(7) {
            let direct: f64 = incident.iter().map(|&(d, radiance)| radiance * phase.pdf(dot(d, w))).sum();
            let y = all(w);
            let scaled: f64 = (0..=MAX_ORDER)
                .map(|l| phase.legendre(l) * (l * l..count(l)).map(|i| coefficients[i] * y[i]).sum::<f64>())
                .sum();
            assert!((direct - scaled).abs() < 1e-12, "{phase:?} towards {w:?}: {direct} for {scaled}");
        }
    }
}
