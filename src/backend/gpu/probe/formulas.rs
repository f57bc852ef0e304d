//! Formulas that know of no scene.

use super::{Inputs, Twin, about, directions, drawn, numbers, relative, some_words};
use crate::physics::flight::{ball_range, box_range, mean_transmittance};
use crate::physics::frame::{orthonormal, rotate, sphere};
use crate::physics::harmonics::{MAX_ORDER, count, evaluate};
use crate::physics::real::{Real, cell};
use crate::physics::rng::{Draws, exponential, rounding, uniform, words};
use crate::tally::rounded;

/// All of them.
pub fn all() -> Vec<Twin<'static>> {
    [real(), rng(), wide(), frame(), harmonics(), flight()].into_iter().flatten().collect()
}

/// `real.wgsl`.
fn real() -> Vec<Twin<'static>> {
    let of = |function, body, inputs| Twin::new("real", function, body, numbers(inputs));
    let between = |from: f32, to: f32| (0..=1000).map(move |i| from + (to - from) * (i as f32 / 1000.0));
    let tiny = |sign: f32| (0..30).map(move |i| sign * 10f32.powi(-i));
    let positive = some_words().into_iter().map(uniform).chain(tiny(1.0)).chain([1.0, 0.99999994, 1.0000001, 2.0]);
    let large = (0..120).map(|i| 1.9f32.powi(i));
    // e^88.3 is within single precision, and so is e^-87.2.
    let exponents: Vec<f32> =
        between(-87.2, 88.3).chain(between(-1.0, 1.0)).chain(tiny(1.0)).chain(tiny(-1.0)).chain([0.0]).collect();
    let beyond = [-87.4, -1000.0, -3e38];
    let turns = between(-1.0, 2.0).chain(tiny(1.0)).chain(tiny(-1.0)).chain([0.0, 0.125, 0.25, 1000.5, -1048575.1]);
    let from_zero = [0.0, 1e-30, 0.49999997, 0.5, 0.99999994, 1.0, 511.99997, 512.0, 4194303.5];
    let cells: Vec<f32> = between(0.0, 4000.0).chain(from_zero).collect();
    let floors: Vec<f32> = cells.iter().flat_map(|&x| [x, -x]).chain([-1e-30, 2147483500.0, -2147483600.0]).collect();
    vec![
        // Eight products, all of which may be fused, on a sum that begins with its largest term.
        of("ln", "return vec4(ln(a.x));", positive.chain(large).collect())
            .single(4.0, |i| about(1e-7, [Real::ln(i.a[0])]))
            .double(4.0, |i| about(1e-7, [f64::from(i.a[0]).ln()])),
        of("ln_1p", "return vec4(ln_1p(a.x));", between(-0.29, 0.41).chain(tiny(0.4)).chain(tiny(-0.29)).collect())
            .double(6.0, |i| relative([f64::from(i.a[0]).ln_1p()])),
        // Its sine and cosine are a unit off, too.
        of("angle", "let t = sin_cos_turn(a.x);\n    return vec4(angle(t.x, t.y));", between(-0.499, 0.499).collect())
            .double(8.0, |i| about(1.0, [f64::from(i.a[0]) * std::f64::consts::TAU])),
        // Towards pi / 2 a compiler may take the two numbers that it is the sum of for one, 4e-8 off.
        of("tangent", "return vec4(tangent(a.x));", between(-1.5, 1.5).chain(tiny(1.0)).collect())
            .double(16.0, |i| about(1e-3, [f64::from(i.a[0]).tan()])),
        // A product that is rounded to the other power leaves a remainder at the other end of the polynomial.
        of("expo", "return vec4(expo(a.x));", exponents.iter().copied().chain(beyond).collect())
            .single(4.0, |i| relative([Real::exp(i.a[0])]))
            .double(4.0, |i| relative([if i.a[0] < -87.3 { 0.0 } else { f64::from(i.a[0]).exp() }])),
        // The sum of two parts, of which either may be larger.
        of("expo_m1", "return vec4(expo_m1(a.x));", exponents).double(6.0, |i| relative([f64::from(i.a[0]).exp_m1()])),
        of("sin_cos_turn", "return vec4(sin_cos_turn(a.x), 0.0, 0.0);", turns.collect())
            .single(2.0, |i| about(1.0, <[f32; 2]>::from(i.a[0].sin_cos_turn())))
            .double(2.0, |i| about(1.0, <[f64; 2]>::from(f64::from(i.a[0]).sin_cos_turn()))),
        Twin::words("real", "cell", "return vec4(bitcast<u32>(cell(a.x)));", numbers(cells), |i| [cell(i.a[0]) as u32]),
        Twin::words("real", "floor_i", "return vec4(bitcast<u32>(floor_i(a.x)));", numbers(floors), |i| {
            [i.a[0].floor() as i32 as u32]
        }),
    ]
}

/// `rng.wgsl`.
fn rng() -> Vec<Twin<'static>> {
    let w = |w| Inputs { w, ..Inputs::default() };
    let mut counters = drawn(200, |_, words| w(words));
    counters.extend([w([0; 4]), w([u32::MAX; 4]), w([0, 0, u32::MAX, u32::MAX]), w([u32::MAX, 0, 0, 1])]);
    let given: Vec<Inputs> = some_words().into_iter().map(|word| w([word, 1, 2, 3])).collect();
    vec![
        Twin::words("rng", "words", "return words(w.xy, w.zw, w.x, w.y);", counters.clone(), |Inputs { w, .. }| {
            words([w[0], w[1]], [w[2], w[3]], w[0], w[1])
        }),
        Twin::words(
            "rng",
            "next4",
            "var d = Draws(w.xy, w.zw, 0u, 9u);\n    let first = next4(&d);\n    return first ^ next4(&d);",
            counters,
            |Inputs { w, .. }| -> [u32; 4] {
                let mut draws = Draws::new([w[0], w[1]], u64::from(w[2]) | u64::from(w[3]) << 32, 9);
                let first = draws.next4();
                let second = draws.next4();
                std::array::from_fn(|k| first[k] ^ second[k])
            },
        ),
        // A word of more than 24 bits may be cut where the CPU rounds to the nearest float.
        Twin::new("rng", "unit", "return vec4(unit(w.x));", given.clone())
            .single(1.0, |i| relative([uniform(i.w[0])]))
            .double(1.0, |i| relative([(f64::from(i.w[0]) + 0.5) / 4294967296.0])),
        Twin::new("rng", "rounding", "return vec4(rounding(w.x));", given.clone())
            .single(1.0, |i| relative([rounding(i.w[0])])),
        Twin::new(
            "rng",
            "exponential",
            "var d = Draws(w.yz, w.zw, 0u, 4u);\n    return vec4(exponential(w.x, &d), f32(d.block), 0.0, 0.0);",
            given,
        )
        .single(4.0, |Inputs { w, .. }| {
            let mut draws = Draws::new([w[1], w[2]], u64::from(w[2]) | u64::from(w[3]) << 32, 4);
            let flight = exponential(w[0], &mut draws);
            about(1.0, [flight, draws.block() as f32])
        }),
    ]
}

/// `wide.wgsl`.
fn wide() -> Vec<Twin<'static>> {
    fn low(i: &Inputs) -> u64 {
        u64::from(i.w[0]) | u64::from(i.w[1]) << 32
    }
    fn high(i: &Inputs) -> u64 {
        u64::from(i.w[2]) | u64::from(i.w[3]) << 32
    }
    fn two(x: u64) -> [u32; 2] {
        crate::physics::rng::split(x)
    }
    let ends = [0, 1, 0xffff, 0x1_0000, 0x7fff_ffff, 0x8000_0000, u32::MAX];
    let mut inputs = drawn(200, |_, w| Inputs { w, ..Inputs::default() });
    for x in ends {
        for y in ends {
            inputs.extend([[x, y, y, x], [x, y, x, y], [x, x, y, y]].map(|w| Inputs { w, ..Inputs::default() }));
        }
    }
    let sizes = (-60..62).map(|b| 2f32.powi(b)).chain([0.3, 0.99999994, 255.5, 1e6, 4294967300.0, 1.7e10]);
    let floats = sizes.flat_map(|x| [x, -x, 1.37 * x, -1.37 * x]).chain([0.0]);
    let chances = [2.3e-10, 1e-6, 0.3, 0.36999, 0.5, 0.9999999, 1.0];
    let sums = floats.flat_map(|x| chances.map(|xi| Inputs { a: [x, xi, 0.0, 0.0], ..Inputs::default() })).collect();
    let mut fractions: Vec<Inputs> = inputs.iter().copied().filter(|i| low(i) < high(i)).collect();
    fractions.extend(
        inputs
            .iter()
            .filter(|i| high(i) < low(i))
            .map(|i| Inputs { w: [i.w[2], i.w[3], i.w[0], i.w[1]], ..Inputs::default() }),
    );
    let of =
        |function, body, answer: fn(&Inputs) -> [u32; 2]| Twin::words("wide", function, body, inputs.clone(), answer);
    vec![
        of("mul_wide", "return vec4(mul_wide(w.x, w.z), 0u, 0u);", |i| two(u64::from(i.w[0]) * u64::from(i.w[2]))),
        of("mul_hi", "return vec4(mul_hi(w.x, w.z), 0u, 0u, 0u);", |i| {
            [two(u64::from(i.w[0]) * u64::from(i.w[2]))[1], 0]
        }),
        of("add64", "return vec4(add64(w.xy, w.zw), 0u, 0u);", |i| two(low(i).wrapping_add(high(i)))),
        of("sub64", "return vec4(sub64(w.xy, w.zw), 0u, 0u);", |i| two(low(i).wrapping_sub(high(i)))),
        of("less64", "return vec4(u32(less64(w.xy, w.zw)), 0u, 0u, 0u);", |i| [u32::from(low(i) < high(i)), 0]),
        of("times64", "return vec4(times64(w.x, w.zw), 0u, 0u);", |i| two(u64::from(i.w[0]).wrapping_mul(high(i)))),
        of("mul_high64", "return vec4(mul_high64(w.x, w.zw), 0u, 0u);", |i| {
            two(((u128::from(i.w[0]) * u128::from(high(i))) >> 32) as u64)
        }),
        of("negate64", "return vec4(negate64(w.xy), 0u, 0u);", |i| two(low(i).wrapping_neg())),
        of("shift64", "return vec4(shift64(w.xy, w.z % 64u), 0u, 0u);", |i| two(low(i) << (i.w[2] % 64))),
        Twin::words("wide", "wide_rounded", "return vec4(wide_rounded(a.x, a.y), 0u, 0u);", sums, |i| {
            two(rounded(i.a[0], i.a[1]) as u64)
        }),
        Twin::new("wide", "float64", "return vec4(float64(w.xy));", inputs.clone())
            .double(2.0, |i| relative([low(i) as f64])),
        // Right to 2^-31, and cut off.
        Twin { of: "u32", ..Twin::new("wide", "fraction64", "return vec4(fraction64(w.xy, w.zw));", fractions) }
            .double(3.0, |i| [(low(i) as f64 / high(i) as f64 * 4294967296.0, 1.0 / f64::from(f32::EPSILON))]),
    ]
}

/// `frame.wgsl`; lengths are 1, so that errors are absolute.
fn frame() -> Vec<Twin<'static>> {
    let turned = |w: [f32; 3], u: [f32; 4]| Inputs { a: [w[0], w[1], w[2], 0.0], b: u, ..Inputs::default() };
    let pairs: Vec<Inputs> = directions().into_iter().map(|w| turned(w, [0.0; 4])).collect();
    let turns = [[1.0, 0.0, 0.0, 0.0], [-1.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.5, 0.0], [0.6, -0.8, 1e-9, 0.0]];
    let mut rotations: Vec<Inputs> = directions().iter().flat_map(|&w| turns.map(|u| turned(w, u))).collect();
    rotations.extend(drawn(200, |u, _| {
        let c = 2.0 * u[2] - 1.0;
        turned(sphere(u[0], u[1]), [c, (1.0 - c * c).sqrt(), u[3], 0.0])
    }));
    let ends = [0.0, 1e-10, 0.5, 0.99999994, 1.0];
    let mut points: Vec<Inputs> = drawn(200, |u, _| Inputs { a: [u[0], u[1], 0.0, 0.0], ..Inputs::default() });
    points.extend(ends.iter().flat_map(|&x| ends.map(|t| Inputs { a: [x, t, 0.0, 0.0], ..Inputs::default() })));
    fn double(w: [f32; 3]) -> [f64; 3] {
        w.map(f64::from)
    }
    let of = |function, body, inputs| Twin::new("frame", function, body, inputs);
    vec![
        of("orthonormal", "return vec4(orthonormal(a.xyz).u, 0.0);", pairs.clone())
            .single(6.0, |i| about(1.0, orthonormal(i.p()).0))
            .double(6.0, |i| about(1.0, orthonormal(double(i.p())).0)),
        of("orthonormal", "return vec4(orthonormal(a.xyz).v, 0.0);", pairs)
            .single(6.0, |i| about(1.0, orthonormal(i.p()).1))
            .double(6.0, |i| about(1.0, orthonormal(double(i.p())).1)),
        of("rotate", "return vec4(rotate(a.xyz, b.x, b.y, b.z), 0.0);", rotations)
            .single(12.0, |i| about(1.0, rotate(i.p(), i.b[0], i.b[1], i.b[2])))
            .double(12.0, |i| {
                let [cos_theta, sin_theta, xi] = double(i.v());
                about(1.0, rotate(double(i.p()), cos_theta, sin_theta, xi))
            }),
        of("sphere", "return vec4(sphere(a.x, a.y), 0.0);", points)
            .single(6.0, |i| about(1.0, sphere(i.a[0], i.a[1])))
            .double(6.0, |i| about(1.0, sphere(f64::from(i.a[0]), f64::from(i.a[1])))),
    ]
}

/// `harmonics.wgsl`: four entries at a time. Each order adds two products and a sum to the largest value, about 1.
fn harmonics() -> Vec<Twin<'static>> {
    fn entries<R: Real>(d: [R; 3], i: &Inputs) -> [R; 4] {
        let mut out = [R::of(0.0); count(MAX_ORDER)];
        evaluate(d, i.w[0] as usize, &mut out);
        std::array::from_fn(|k| out[i.w[1] as usize + k])
    }
    let mut inputs = Vec::new();
    for (at, d) in directions().into_iter().enumerate() {
        let orders = if at < 12 { 0..=MAX_ORDER } else { MAX_ORDER..=MAX_ORDER };
        for order in orders {
            for first in (0..count(MAX_ORDER) as u32).step_by(4) {
                let first = first.min(count(MAX_ORDER) as u32 - 4);
                inputs.push(Inputs { a: [d[0], d[1], d[2], 0.0], b: [0.0; 4], w: [order as u32, first, 0, 0] });
            }
        }
    }
    let body = "var out: array<f32, 81>;\n    evaluate(a.xyz, w.x, &out);\n    \
                return vec4(out[w.y], out[w.y + 1u], out[w.y + 2u], out[w.y + 3u]);";
    vec![
        Twin::new("harmonics", "evaluate", body, inputs)
            .single(16.0, |i| about(1.0, entries(i.p(), i)))
            .double(16.0, |i| about(1.0, entries(i.p().map(f64::from), i))),
    ]
}

/// `flight.wgsl`.
fn flight() -> Vec<Twin<'static>> {
    let depths = (0..400).map(|i| 1e-6 * 1.05f32.powi(i)).filter(|&tau| tau < 87.0).chain([0.0, 1e-30, 1e-3, 1.01e-3]);
    let through = |function,
                   body,
                   inputs: Vec<Inputs>,
                   hit: fn(&Inputs) -> Option<(f64, f64)>,
                   size: fn(&Inputs, (f64, f64)) -> f64| {
        Twin::new("flight", function, body, inputs).double(8.0, move |i| match hit(i) {
            Some(range) => [(1.0, 1.0), (range.0, size(i, range)), (range.1, size(i, range))],
            None => [(0.0, 1.0); 3],
        })
    };
    let line = |p: [f32; 3], v: [f32; 3]| Inputs { a: [p[0], p[1], p[2], 0.0], b: [v[0], v[1], v[2], 0.0], w: [0; 4] };
    let random = drawn(400, |u, w| {
        let p: [f32; 3] = std::array::from_fn(|a| 16.0 * u[a] - 5.0);
        // Some lines are parallel to a face.
        let v = std::array::from_fn(|a| if w[0] % 8 == a as u32 { 0.0 } else { u[3 + a] - 0.5 });
        line(p, v)
    });
    let mut boxes = random.clone();
    boxes.extend([
        line([0.0, 2.0, 3.0], [0.0, 1.0, 0.0]),
        line([5.0, -2.0, 7.0], [0.0, 1.0, 0.0]),
        line([-1.0, 2.0, 3.0], [0.0, 1.0, 0.0]),
        line([2.0, 2.0, -1e6], [1e-7, 0.0, 1.0]),
        line([2.0, 2.0, 3.0], [1e-20, -1e-20, 1e-20]),
    ]);
    let whole = |i: &Inputs| box_range(i.p().map(f64::from), i.v().map(f64::from), [5.0, 6.0, 7.0]);
    let ball = |i: &Inputs| ball_range(i.p().map(f64::from), i.v().map(f64::from), 3.0);
    // Lines that just graze are left out: rounding decides them.
    let clear = |i: &Inputs, radius: f64| {
        let wider = ball_range(i.p().map(|c| f64::from(c) + 0.1), i.v().map(f64::from), radius + 0.1);
        let closer = ball_range(i.p().map(|c| f64::from(c) - 0.1), i.v().map(f64::from), radius - 0.1);
        wider.is_some() == closer.is_some()
    };
    let balls = random.into_iter().filter(|i| clear(i, 3.0)).collect();
    vec![
        Twin::new("flight", "mean_transmittance", "return vec4(mean_transmittance(a.x));", numbers(depths))
            .single(6.0, |i| relative([mean_transmittance(i.a[0])])),
        through(
            "box_range",
            "let r = box_range(a.xyz, b.xyz, vec3(5.0, 6.0, 7.0));\n    \
             return select(vec4(0.0), vec4(1.0, r, 0.0), r.x < r.y);",
            boxes,
            whole,
            |_, (enter, leave)| enter.abs().max(leave.abs()),
        ),
        // The point nearest to the centre is as sure as the way to it is long, and the ends less where they are near it.
        through(
            "ball_range",
            "let r = ball_range(a.xyz, b.xyz, 3.0);\n    \
             return select(vec4(0.0), vec4(1.0, r, 0.0), r.x < r.y);",
            balls,
            ball,
            |i, (enter, leave)| {
                let square = |x: [f32; 3]| x.iter().map(|&c| f64::from(c) * f64::from(c)).sum::<f64>();
                let way = square(i.p().map(|c| c - 3.0)) / square(i.v());
                enter.abs().max(leave.abs()) + 2.0 * way / (leave - enter)
            },
        ),
    ]
}
