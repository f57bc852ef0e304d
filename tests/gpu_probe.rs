//! The shaders' formulas on the adapter that is there, against their Rust twins.
#![cfg(feature = "gpu")]

use mcrt::backend::gpu::Gpu;
use mcrt::backend::gpu::probe::{Probe, run, run_altered};
use mcrt::backend::gpu::sources::{ALL, COMMON, KINDS, read};
use std::cell::RefCell;
use std::collections::HashSet;
use std::sync::Arc;

fn gpu() -> Arc<Gpu> {
    Gpu::open("").expect("an adapter")
}

#[test]
fn every_formula_is_its_twin_but_for_rounding() {
    let probes = run(&gpu()).expect("they run");
    for p in &probes {
        println!("{:<18} {:<20} {} {:>6} {:>9.3} of {}", p.file, p.function, p.against, p.cases, p.worst, p.bound);
    }
    let wrong: Vec<&Probe> = probes.iter().filter(|p| !p.agrees()).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn a_wrong_formula_is_named() {
    let gpu = gpu();
    for (file, function, right, wrong) in [
        // A coefficient in its fifth digit.
        ("real", "ln", "3.333333e-1", "3.3334e-1"),
        ("rng", "words", "0xD2511F53u", "0xD2511F52u"),
        ("wide", "mul_wide", "(upper >> 16u) + ", "(upper >> 16u) | "),
        ("frame", "sphere", "1.0 - 2.0 * xi", "2.0 * xi - 1.0"),
        ("phase_hg", "phase_sample", "1.0 + q * x", "1.0 - q * x"),
        ("flight", "mean_transmittance", "tau * (0.5 - tau", "tau * (0.501 - tau"),
        ("lookup_linear", "value_at", "u.y * (x.y - x.x)", "u.y * (x.y + x.x)"),
        ("light", "incident", "1.0 / d2, distance", "1.0 / distance, distance"),
    ] {
        let text = read(file).expect("it is there");
        assert!(text.contains(right), "{file} has no {right}");
        let probes = run_altered(&gpu, &|text| text.replace(right, wrong)).expect("they run");
        let named = probes.iter().any(|p| (p.file, p.function) == (file, function) && !p.agrees());
        assert!(named, "{file}: {wrong} is not found wrong");
    }
}

#[test]
fn every_formula_is_probed() {
    let texts = RefCell::new(Vec::new());
    let keep = |text: String| {
        texts.borrow_mut().push(text.clone());
        text
    };
    run_altered(&gpu(), &keep).expect("they run");
    let mut probed = HashSet::new();
    for text in texts.into_inner() {
        let module = &mut naga::front::wgsl::parse_str(&text).expect("it is valid");
        // What `main` does not reach is left out.
        naga::compact::compact(module, naga::compact::KeepUnused::No);
        let names: HashSet<String> = module.functions.iter().filter_map(|(_, f)| f.name.clone()).collect();
        for (file, body) in ALL.iter().filter(|(_, body)| text.contains(body)) {
            let declared = body.lines().filter_map(|line| line.strip_prefix("fn ")?.split('(').next());
            probed.extend(declared.filter(|name| names.contains(*name)).map(|name| (*file, name)));
        }
    }
    let kinds = KINDS.iter().flat_map(|row| row.split(" | "));
    for file in COMMON.iter().copied().chain(kinds).chain(["light", "harmonics"]) {
        let (_, body) = ALL.iter().find(|(name, _)| *name == file).expect("it is there");
        for name in body.lines().filter_map(|line| line.strip_prefix("fn ")?.split('(').next()) {
            assert!(probed.contains(&(file, name)), "{file}: no probe calls {name}");
        }
    }
}
