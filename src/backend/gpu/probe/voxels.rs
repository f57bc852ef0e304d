//! Formulas that read a scene: small scenes of every kind.

use super::super::lights::Lights;
use super::super::scene::GpuScene;
use super::{Bench, Inputs, Measured, Twin, about, drawn, formulas, relative, some_words};
use crate::backend::cpu::collision_medium;
use crate::backend::cpu::light::Illumination;
use crate::error::Result;
use crate::physics::flight::{ball_range, box_range, mean_transmittance};
use crate::physics::rng::uniform;
use crate::physics::{Phase, Real};
use crate::plan::Column;
use crate::scene::field::{Dda, Field, along, jitter, leave, local};
use crate::scene::{Albedo, Camera, Light, Medium, Scene, Spectrum, Volume};

/// Voxels along x, y, z.
const N: [usize; 3] = [5, 4, 3];

/// What the voxels of a probed scene hold.
#[derive(Clone, Copy)]
struct Kind {
    linear: bool,
    /// The smallest step between densities; 0 for a constant ball.
    step: f32,
    channels: usize,
    albedo_voxels: bool,
}

/// Runs the probes of all kinds of scene, and those that know of none in the first.
pub fn run(bench: &mut Bench) -> Result<()> {
    let kinds = [
        // Densities that single precision, half precision and bytes hold.
        Kind { linear: true, step: 0.01, channels: 3, albedo_voxels: true },
        Kind { linear: false, step: 0.125, channels: 1, albedo_voxels: false },
        Kind { linear: true, step: 1.0, channels: 1, albedo_voxels: true },
        Kind { linear: false, step: 0.0, channels: 3, albedo_voxels: false },
    ];
    let table = Phase::tabulated(&[-1.0, -0.5, 0.1, 0.7, 0.95, 1.0], &[0.3, 0.1, 0.02, 0.4, 2.0, 9.0])?;
    let mut phases = vec![Phase::Isotropic, Phase::Rayleigh, table];
    for g in [0.9, -0.5, 1e-6, 0.999_999, -0.999_999] {
        phases.push(Phase::henyey_greenstein(g)?);
    }
    for (at, phase) in phases.into_iter().enumerate() {
        let kind = kinds[at.min(kinds.len() - 1)];
        let whole = |i: usize| (i * 7919 + 13) % 101;
        let voxels = N.iter().product();
        let values: Vec<f32> = (0..voxels).map(|i| whole(i) as f32 * kind.step).collect();
        let albedos: Vec<f32> = (0..voxels).map(|i| (whole(i + 3) as f32) / 128.0).collect();
        let volume = if kind.step > 0.0 {
            Volume::new(&values, N, [0.5, 1.0, 2.0], [0.0; 3], kind.linear)?
        } else {
            Volume::new(&[0.7], [1; 3], [2.0; 3], [0.0; 3], kind.linear)?.ball()?
        };
        let colour = Spectrum::new(&[0.9, 0.5, 0.2][..kind.channels], "value")?;
        let albedo = if kind.albedo_voxels { Albedo::PerVoxel(&albedos) } else { Albedo::Constant(colour) };
        let medium = Medium::new(volume, colour, albedo, phase)?;
        let lights = vec![Light::point([1.1, 2.6, 8.4], &[1.0])?, Light::directional([0.3, -0.5, -0.8], &[2.0])?];
        let camera = Camera::perspective([30.0, -30.0, 20.0], [2.0; 3], [0.0, 0.0, 1.0], 20.0, [9, 9])?;
        let scene = Scene::new(medium, lights, camera);
        let on_gpu = GpuScene::new(bench.gpu, &scene, kind.channels)?;
        if at == 0 {
            bench.run(&on_gpu, &["harmonics"], &[], &formulas::all())?;
        }
        bench.run(&on_gpu, &[], &[], &phase_functions(&scene.medium.phase))?;
        if at < kinds.len() {
            bench.run(&on_gpu, &[], &[], &spectra(&scene))?;
            bench.run(&on_gpu, &[], &[], &lines(&scene))?;
            bench.run(&on_gpu, &[], &[], &voxels_of(&scene))?;
            lit(bench, &scene, &on_gpu)?;
        }
    }
    Ok(())
}

/// `phase.wgsl` and the file of the phase function.
fn phase_functions(phase: &Phase) -> Vec<Twin<'_>> {
    let file = match phase {
        Phase::Isotropic => "phase_isotropic",
        Phase::Rayleigh => "phase_rayleigh",
        Phase::HenyeyGreenstein { .. } => "phase_hg",
        Phase::Tabulated(_) => "phase_tabulated",
    };
    let near = (1..24).flat_map(|i| [1.0 - 0.5f32.powi(i), 0.5f32.powi(i) - 1.0]);
    let between = (0..=500).map(|i| (i - 250) as f32 / 250.0);
    let cosines = super::numbers(near.chain(between).collect::<Vec<_>>());
    let numbers = super::numbers(some_words().into_iter().map(uniform).chain([0.5, 0.99999994]));
    // The cosine is as sure as its distribution is steep, or than 1 - |cosine| is in a peak; the sine than sqrt(1 - cos^2).
    let sizes = move |cos_theta: f64, sin_theta: f64| -> [Measured; 2] {
        let density = std::f64::consts::TAU * phase.pdf(cos_theta);
        let (steep, rest) = match phase {
            Phase::HenyeyGreenstein { g } => (1.0, if *g < 0.0 { 1.0 + cos_theta } else { 1.0 - cos_theta }),
            _ => (1.0 + 1.0 / density.max(3.5e-4), 1.0),
        };
        let size = sin_theta.max(steep * rest / sin_theta.max(3.5e-4));
        [(cos_theta, steep), (sin_theta, size.max(f64::from(f32::MIN_POSITIVE)))]
    };
    vec![
        // d sqrt(d) of a sum of two terms, and a quotient.
        Twin::new(file, "phase_pdf", "return vec4(phase_pdf(a.x));", cosines)
            .single(8.0, |i| about(1e-3, [phase.pdf(i.a[0])]))
            .double(8.0, |i| about(1e-3, [phase.pdf(f64::from(i.a[0]))])),
        Twin::new(file, "phase_sample", "return vec4(phase_sample(a.x), 0.0, 0.0);", numbers)
            .single(8.0, move |i| {
                let (cos_theta, sin_theta) = phase.sample(i.a[0]);
                sizes(f64::from(cos_theta), f64::from(sin_theta))
            })
            .double(8.0, move |i| {
                let (cos_theta, sin_theta) = phase.sample(f64::from(i.a[0]));
                sizes(cos_theta, sin_theta)
            }),
    ]
}

/// `channels_1.wgsl` or `channels_3.wgsl`.
fn spectra<'a>(scene: &Scene) -> Vec<Twin<'a>> {
    let channels = scene.channels();
    let file = if channels == 1 { "channels_1" } else { "channels_3" };
    let inputs = drawn(40, |u, w| Inputs { a: std::array::from_fn(|k| 3.0 * u[k] - 2.0), b: [0.0; 4], w });
    let seen = move |i: &Inputs| if channels == 1 { [i.a[0]; 3] } else { i.p() };
    vec![
        Twin::new(file, "rgb", "return vec4(rgb(spectrum(a.xyz)), 0.0);", inputs.clone())
            .single(0.0, move |i| relative(seen(i))),
        Twin::new(file, "channel", "return vec4(channel(spectrum(a.xyz), w.x % 3u));", inputs.clone())
            .single(0.0, move |i| relative([seen(i)[(i.w[0] % 3) as usize]])),
        Twin::new(file, "largest", "return vec4(largest(spectrum(a.xyz)));", inputs.clone())
            .single(0.0, move |i| relative([seen(i).into_iter().fold(0.0, f32::max)])),
        Twin::new(
            file,
            "mean_transmittances",
            "return vec4(rgb(mean_transmittances(spectrum(abs(a.xyz)))), 0.0);",
            inputs.clone(),
        )
        .single(6.0, move |i| relative(seen(i).map(|tau| mean_transmittance(tau.abs())))),
        Twin::new(file, "expos", "return vec4(rgb(expos(spectrum(a.xyz))), 0.0);", inputs)
            .single(4.0, move |i| relative(seen(i).map(Real::exp))),
    ]
}

/// Points of the medium with velocities of all signs, some of which are 0: `p = a`, `v = b`, a length, and a number.
fn rays(scene: &Scene) -> Vec<Inputs> {
    let volume = &scene.medium.volume;
    let n = volume.n().map(|m| m as f32);
    drawn(300, |u, w| {
        let p: [f32; 3] = std::array::from_fn(|a| {
            // Within the ball too.
            let within = if volume.is_ball() { 0.25 + 0.5 * u[a] } else { u[a] };
            within * n[a]
        });
        let v: [f32; 3] = std::array::from_fn(|a| if w[1] % 8 == a as u32 { 0.0 } else { 4.0 * u[3 + a] - 2.0 });
        Inputs { a: [p[0], p[1], p[2], 6.0 * u[6]], b: [v[0], v[1], v[2], u[7]], w }
    })
}

/// `line.wgsl` and the file of the edge.
fn lines<'a>(scene: &'a Scene) -> Vec<Twin<'a>> {
    let n = scene.medium.volume.n().map(|m| m as i32);
    let field = Field::density(&scene.medium.volume);
    let mut inputs = rays(scene);
    // Along an axis on the lines between voxels, and through corners.
    for (p, v) in [([2.0, 1.0, 0.5], [0.0, 0.0, 1.0]), ([0.5, 0.5, 0.5], [1.0, 1.0, 1.0]), ([5.0, 4.0, 3.0], [-1.0; 3])]
    {
        for w in 0..4 {
            inputs.push(Inputs { a: [p[0], p[1], p[2], 1.0], b: [v[0], v[1], v[2], 1.0], w: [w, 0, 0, 0] });
        }
    }
    let stepped = move |i: &Inputs| {
        let mut walk = Dda::new(i.p(), i.v(), [-1; 3], n);
        let mut on = 1;
        for _ in 0..i.w[0] % 4 {
            on *= u32::from(walk.advance(walk.exit().0));
        }
        (walk, on)
    };
    let walked = "var walk = dda(a.xyz, b.xyz, vec3(-1), scene.n);\n    \
                  var on = 1u;\n    \
                  for (var k = 0u; k < w.x % 4u; k++) {\n        \
                  on *= u32(dda_advance(&walk, dda_axis(&walk)));\n    \
                  }\n    ";
    let mut twins =
        vec![Twin::new("line", "along", "return vec4(along(a.xyz, b.xyz, a.w), 0.0);", inputs.clone()).single(
            2.0,
            |i| {
                let size = (0..3).map(|a| (i.a[a].abs()).max((i.b[a] * i.a[3]).abs())).fold(0.0, f32::max);
                about(f64::from(size), along(i.p(), i.v(), i.a[3]))
            },
        )];
    let edge = if field.is_ball() { "edge_ball" } else { "edge_box" };
    if !field.is_ball() {
        let cell = format!("{walked}return vec4(bitcast<vec3<u32>>(walk.cell), on);");
        let next = format!("{walked}return vec4(walk.next[dda_axis(&walk)]);");
        twins.extend([
            Twin::words("line", "dda_advance", cell, inputs.clone(), move |i| {
                let (walk, on) = stepped(i);
                [walk.cell[0] as u32, walk.cell[1] as u32, walk.cell[2] as u32, on]
            }),
            // A quotient, and up to three sums.
            Twin::new("line", "dda_axis", next, inputs.clone()).single(8.0, move |i| relative([stepped(i).0.exit().1])),
            Twin::words("edge_box", "leave", "return vec4(u32(leave(a.xyz, b.xyz).axis));", inputs.clone(), move |i| {
                [leave(i.p(), i.v(), n).0 as u32]
            }),
        ]);
    }
    twins.push(
        Twin::new(edge, "leave", "return vec4(leave(a.xyz, b.xyz).t);", inputs)
            .single(if field.is_ball() { 12.0 } else { 4.0 }, move |i| relative([field.leave(i.p(), i.v()).1])),
    );
    // The way to the point nearest to a ball's centre is as sure as it is long, and the ends less where they are near it.
    let ball = field.is_ball();
    let met = "let r = meet(a.xyz, b.xyz);\n    return select(vec4(0.0), vec4(1.0, r, 0.0), r.x < r.y);";
    twins.push(Twin::new(edge, "meet", met, rays(scene)).double(8.0, move |i| {
        let (p, v) = (i.p().map(f64::from), i.v().map(f64::from));
        let range = if ball { ball_range(p, v, 0.5) } else { box_range(p, v, n.map(f64::from)) };
        let (enter, leave) = range.unwrap_or_default();
        let size = enter.abs().max(leave.abs()) + if ball { 1.0 / (leave - enter) } else { 0.0 };
        [(f64::from(u8::from(range.is_some())), 1.0), (enter, size), (leave, size)]
    }));
    // Points on both sides of the edge, and on the faces.
    let mut points = rays(scene);
    for i in &mut points {
        let onto = i.w[2] as usize % 6;
        for a in 0..3 {
            i.a[a] += 0.7 * (i.a[a] - 0.5 * n[a] as f32);
        }
        if i.w[3] % 4 == 0 && !field.is_ball() {
            i.a[onto % 3] = if onto < 3 { 0.0 } else { n[onto % 3] as f32 };
        }
    }
    twins.push(Twin::words(edge, "contains", "return vec4(u32(contains(a.xyz)));", points, move |i| {
        let [x, y, z] = i.p().map(|c| c - 0.5);
        let inside = if field.is_ball() {
            x * x + y * y + z * z < 0.25
        } else {
            (0..3).all(|a| i.a[a] >= 0.0 && i.a[a] < n[a] as f32)
        };
        [u32::from(inside)]
    }));
    twins
}

/// `lookup.wgsl` and the files of the density, its lookup and the albedo.
fn voxels_of<'a>(scene: &'a Scene) -> Vec<Twin<'a>> {
    let medium = &scene.medium;
    let volume = &medium.volume;
    let (field, n) = (Field::density(volume), volume.n().map(|m| m as i32));
    let top = volume.max();
    let mut inputs = rays(scene);
    // Faces and corners of the box, and the outermost voxel centres.
    let places = |a: usize| [0.0, 0.5, 1.0, n[a] as f32 - 0.5, n[a] as f32];
    for at in 0..125 {
        let p = [places(0)[at % 5], places(1)[at / 5 % 5], places(2)[at / 25]];
        inputs.push(Inputs { a: [p[0], p[1], p[2], 4.0], b: [0.3, -0.7, 0.9, 1.0], w: [at as u32, 0, 0, 0] });
    }
    if volume.is_ball() {
        inputs.truncate(300);
    }
    // Some columns end where they are dark.
    let columns: Vec<Inputs> = inputs
        .iter()
        .map(|i| Inputs { b: [i.b[0], i.b[1], i.b[2], if i.w[0] % 2 == 0 { 1e30 } else { 3.0 * top * i.b[3] }], ..*i })
        .collect();
    let (density, lookup) = match (volume.is_constant(), volume.linear()) {
        (true, _) => ("density_constant", ["density_at", "density_read", "column"]),
        (_, true) => ("lookup_linear", ["value_at", "one_read", "integral"]),
        (_, false) => ("lookup_nearest", ["value_at", "one_read", "integral"]),
    };
    let size = f64::from(top);
    let voxel = move |i: &Inputs| -> [i32; 3] { std::array::from_fn(|a| (i.a[a] as i32).clamp(0, n[a] - 1)) };
    let mut twins = vec![
        Twin::new("lookup", "jitter", "return vec4(jitter(w.x), 0.0);", inputs.clone())
            .single(0.0, |i| about(1.0, [0, 1, 2].map(|a| jitter(i.w[0], a)))),
        Twin::words("lookup", "voxel_of", "return vec4(bitcast<vec3<u32>>(voxel_of(a.xyz)), 0u);", inputs.clone(), {
            move |i| voxel(i).map(|c| c as u32)
        }),
        Twin::words("lookup", "index_of", "return vec4(index_of(voxel_of(a.xyz)));", inputs.clone(), move |i| {
            [field.index(voxel(i)) as u32]
        }),
        // Three interpolations of two roundings each, and the unit of a byte.
        Twin::new(density, lookup[0], "return vec4(density_at(a.xyz));", inputs.clone())
            .single(8.0, move |i| about(size, [field.at(i.p())])),
        Twin::new(density, lookup[1], "return vec4(density_read(a.xyz, w.x));", inputs.clone())
            .single(2.0, move |i| relative([field.one_read(i.p(), i.w[0])])),
        // Up to twelve pieces, each with ends that are as sure as the way to them is long.
        Twin::new(density, lookup[2], "return vec4(column(a.xyz, b.xyz, a.w, b.w));", columns).single(16.0, move |i| {
            about(size * f64::from(1.0 + i.a[3]), [field.column_up_to(i.p(), i.v(), i.a[3], i.b[3])])
        }),
    ];
    let cubic = "return density_cubic(voxel_of(a.xyz) - vec3<i32>(w.xyz & vec3(LINEAR)), a.xyz - floor(a.xyz), b.xyz);";
    let cubic = cubic.replace("LINEAR", if volume.linear() { "1u" } else { "0u" });
    twins.push(Twin::new(density, "density_cubic", cubic, inputs.clone()).double(8.0, move |i| {
        if !volume.linear() {
            return about(size, [field.voxel(voxel(i)), 0.0, 0.0, 0.0]);
        }
        let cell = voxel(i);
        let corners = field.corners(std::array::from_fn(|a| cell[a] - (i.w[a] & 1) as i32));
        about(4.0 * size, corners.cubic(i.p().map(|c| f64::from(c - c.floor())), i.v().map(f64::from)))
    }));
    if volume.linear() {
        let body = "return vec4(local(a.xyz, voxel_of(a.xyz) - vec3<i32>(w.xyz & vec3(1u))), 0.0);";
        twins.push(Twin::new("lookup_linear", "local", body, inputs.clone()).single(1.0, move |i| {
            let cell = voxel(i);
            about(1.0, local(i.p(), std::array::from_fn(|a| cell[a] - (i.w[a] & 1) as i32)))
        }));
    }
    if !volume.is_constant() {
        let file = if volume.linear() { "lookup_linear" } else { "lookup_nearest" };
        let body = "let goal = bitcast<f32>(w.w) / scene.texel;\n    \
                    return vec4(invert(density, vec3<i32>(w.xyz) - 1, a.xyz, b.xyz, a.w, b.w, goal));";
        // The search ends at 8 units of the way, and is as sure as the density is large there.
        twins.push(Twin::new(file, "invert", body, goals(&field)).single(16.0, move |i| {
            let cell = [0, 1, 2].map(|a| i.w[a] as i32 - 1);
            if !field.linear() {
                let t = i.a[3] + f32::from_bits(i.w[3]) / field.voxel(cell).max(1e-30);
                return about(f64::from(i.b[3]), [t.min(i.b[3])]);
            }
            let corners = field.corners(cell);
            let t = field.invert(&corners, cell, i.p(), i.v(), (i.a[3], i.b[3]), f32::from_bits(i.w[3]));
            let there = corners.at(local(along(i.p(), i.v(), t), cell));
            about(f64::from((i.b[3] - i.a[3]) * (1.0 + top / there.max(1e-30))), [t])
        }));
    }
    let albedo = match medium.albedo {
        Albedo::Constant(_) => "albedo_constant",
        Albedo::PerVoxel(_) => "albedo_voxels",
    };
    let value = move |i: &Inputs, read: bool| match &medium.albedo {
        Albedo::Constant(a) => a.rgb.map(|c| c as f32),
        Albedo::PerVoxel(values) if read => [Field::new(values, volume).one_read(i.p(), i.w[0]); 3],
        Albedo::PerVoxel(values) => [Field::new(values, volume).at(i.p()); 3],
    };
    let at_points = collision_medium::Medium::new(scene);
    twins.extend([
        Twin::new(albedo, "albedo_at", "return vec4(rgb(albedo_at(a.xyz)), 0.0);", inputs.clone())
            .single(8.0, move |i| about(1.0, value(i, false))),
        Twin::new(albedo, "albedo_read", "return vec4(rgb(albedo_read(a.xyz, w.x)), 0.0);", inputs.clone())
            .single(2.0, move |i| about(1.0, value(i, true))),
        Twin::new(albedo, "relative_absorption", "return vec4(relative_absorption(a.xyz, a.w));", inputs)
            .single(8.0, move |i| about(1.0, [at_points.relative_absorption(i.p(), i.a[3])])),
    ]);
    twins
}

/// Lines through cells from a.w to b.w, and what the integral along them is to reach.
fn goals(field: &Field) -> Vec<Inputs> {
    // Cells of interpolation begin before the first voxel, in whose middle they end.
    let (before, low) = if field.linear() { (1, 0.5) } else { (0, 0.0) };
    drawn(300, |u, w| {
        let cell: [i32; 3] = std::array::from_fn(|a| (w[a] % (N[a] as u32 + before)) as i32 - before as i32);
        let (t0, length) = (u[6], 0.5 + u[7]);
        // From one point of the cell to another.
        let v: [f32; 3] = std::array::from_fn(|a| (u[3 + a] - u[a]) / length);
        let p: [f32; 3] = std::array::from_fn(|a| cell[a] as f32 + low + u[a] - v[a] * t0);
        let goal = uniform(w[3]) * field.piece(cell, p, v, t0, t0 + length);
        let [i, j, k] = cell.map(|c| (c + 1) as u32);
        Inputs { a: [p[0], p[1], p[2], t0], b: [v[0], v[1], v[2], t0 + length], w: [i, j, k, goal.to_bits()] }
    })
}

/// `light.wgsl`: lights with and without a light grid, whose nodes hold any numbers here.
fn lit(bench: &mut Bench, scene: &Scene, on_gpu: &GpuScene) -> Result<()> {
    let volume = &scene.medium.volume;
    let nodes: Vec<f32> =
        (0..volume.n().iter().map(|m| m + 2).product()).map(|i: usize| ((i * 7919) % 89) as f32 / 8.0).collect();
    let views: Vec<Illumination> =
        [(0, Column::Grid, true), (1, Column::Grid, true), (0, Column::Rays, true), (1, Column::Rays, false)]
            .into_iter()
            .filter_map(|(light, column, grid)| {
                Illumination::new(scene, None, &scene.lights[light], column, grid.then_some(nodes.as_slice()))
            })
            .collect();
    let lights = Lights::new(bench.gpu, views.iter().map(|view| (view, 1.0)))?;
    let mut inputs = rays(scene);
    // At the light itself.
    inputs.push(Inputs { a: [2.2, 2.6, 4.2, 0.0], ..Inputs::default() });
    let view = |i: &Inputs| &views[(i.w[3] % 4) as usize];
    // A light ray's parts are as sure as its length.
    let size = f64::from(volume.max()) * 8.0;
    let size = size.max(12.0);
    let of = |function, body: &str| {
        let begin = "let light = lights[w.w % 4u];\n    let at = incident(light, a.xyz);\n    ";
        Twin::new("light", function, format!("{begin}{body}"), inputs.clone())
    };
    let twins = [
        of("incident", "return vec4(at.direction, at.falloff);").single(8.0, |i| {
            let at = view(i).incident(i.p());
            let [x, y, z] = about(1.0, at.direction);
            [x, y, z, relative([at.falloff])[0]]
        }),
        of("incident", "return vec4(at.distance);")
            .single(8.0, |i| relative([view(i).incident(i.p()).distance.min(3e38)])),
        of("rough_column", "return vec4(rough_column(light, a.xyz, at));")
            .single(16.0, |i| about(size, [view(i).rough_column(i.p(), &view(i).incident(i.p()))])),
        of("light_column", "return vec4(light_column(light, a.xyz, at));")
            .single(16.0, |i| about(size, [view(i).column(i.p(), &view(i).incident(i.p()))])),
    ];
    bench.run(on_gpu, &["light"], &lights.bindings(), &twins)
}
