//! What a compiler of shaders would say of them, and what keeps them twins of the Rust code.
#![cfg(feature = "gpu")]

use mcrt::backend::gpu::kernel::parse;
use mcrt::backend::gpu::probe::Inputs;
use mcrt::backend::gpu::scene::Constants;
use mcrt::backend::gpu::sources::{ALL, KERNELS, read};
use mcrt::backend::gpu::{angular, camera, emit, gather, kernels, lights, map, path, shoot};
use mcrt::result::{EXIT_FACES, Share};
use std::collections::HashSet;
use std::fs;
use std::mem::offset_of;
use std::path::Path;

/// The names behind a keyword of a text, in its order.
fn names(text: &str, keyword: &str) -> Vec<String> {
    let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
    let after = code.filter_map(|line| line.split_once(&format!("{keyword} ")));
    let name = |rest: &str| rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
    after.filter(|(before, _)| before.trim().is_empty() || before.ends_with(' ')).map(|(_, rest)| name(rest)).collect()
}

#[test]
fn every_kernel_is_valid_for_every_kind_of_scene() {
    let kernels = kernels();
    for kernel in &kernels {
        let (module, _) = parse(kernel).expect("it is valid");
        assert_eq!(module.entry_points.len(), 1, "{:?}", kernel.files());
    }
    assert!(kernels.len() > KERNELS.len() * 8, "{} kernels", kernels.len());
}

#[test]
fn every_file_is_compiled_in_and_used() {
    let folder = fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders")).expect("it is there");
    let mut files: Vec<String> = folder
        .map(|entry| entry.expect("it can be read").file_name().into_string().expect("a plain name"))
        .filter_map(|name| Some(name.strip_suffix(".wgsl")?.to_string()))
        .collect();
    files.sort();
    let listed: Vec<&str> = ALL.iter().map(|(name, _)| *name).collect();
    assert_eq!(files, listed, "the list in sources.rs");
    let mut used = HashSet::from(["probe"]);
    used.extend(kernels().iter().flat_map(|kernel| kernel.files().to_vec()));
    for name in listed {
        assert!(used.contains(name), "no kernel holds {name}");
        let is_kernel = read(name).expect("it is there").contains("@compute");
        let begins = KERNELS.iter().any(|rows| rows[0].split(' ').next() == Some(name));
        assert!(is_kernel == begins || name == "probe", "{name} among the kernels");
    }
}

/// Shader files with the Rust files of their twins.
const TWINS: [(&str, &str); 11] = [
    ("real", "physics/real.rs"),
    ("rng", "physics/rng.rs"),
    ("frame", "physics/frame.rs"),
    ("phase", "physics/phase.rs"),
    ("phase_isotropic", "physics/phase.rs"),
    ("phase_rayleigh", "physics/phase.rs"),
    ("phase_hg", "physics/phase.rs"),
    ("phase_tabulated", "physics/phase.rs"),
    ("harmonics", "physics/harmonics.rs"),
    ("flight", "physics/flight.rs"),
    ("line", "scene/field/line.rs"),
];

/// Functions with another name in Rust, for which WGSL has its own or no methods; those without one are parts of a
/// function that is written otherwise there.
const RENAMED: [(&str, &str); 22] = [
    ("ln_1p", ""),
    ("ln_parts", ""),
    ("angle", ""),
    ("tangent", ""),
    ("exp_parts", ""),
    ("expo", "exp"),
    ("expo_m1", ""),
    ("floor_i", ""),
    ("philox_round", "philox4x32"),
    ("unit", "uniform"),
    ("knots", ""),
    ("phase_pdf", "pdf"),
    ("phase_sample", "sample"),
    ("newton_step", ""),
    ("first_harmonic", ""),
    ("next_harmonic", ""),
    ("harmonic_pair", ""),
    ("harmonic_index", ""),
    ("floors", ""),
    ("dda", "new"),
    ("dda_axis", "exit"),
    ("dda_advance", "advance"),
];

#[test]
fn functions_stand_in_the_order_of_their_twins() {
    for (shader, rust) in TWINS {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src").join(rust);
        let rust_names = names(&fs::read_to_string(path).expect("it is there"), "fn");
        let mut last = 0;
        for name in names(&read(shader).expect("it is there"), "fn") {
            let twin = RENAMED.iter().find(|(own, _)| *own == name).map_or(name.as_str(), |(_, twin)| twin);
            if twin.is_empty() {
                continue;
            }
            let at = rust_names.iter().position(|one| one == twin);
            let at = at.unwrap_or_else(|| panic!("{shader}.wgsl: {rust} has no {twin}"));
            assert!(at >= last, "{shader}.wgsl: {name} stands elsewhere in {rust}");
            last = at;
        }
    }
}

/// A struct of a shader file: (file, its name, (member, offset in Rust) of all members, size in Rust).
type Layout = (&'static str, &'static str, Vec<(&'static str, usize)>, usize);

macro_rules! layout {
    ($file:literal, $name:literal, $rust:ty, $($member:ident)*) => {
        ($file, $name, vec![$((stringify!($member), offset_of!($rust, $member))),*], size_of::<$rust>())
    };
}

fn layouts() -> Vec<Layout> {
    vec![
        layout!("tables", "Scene", Constants,
            n block h free_path inverse_h top_extinction extinction texel albedo constant ratio albedo_texel cells last eye
            seed enough per_density hg),
        layout!("light", "Light", lights::Light, place is_point value rays first has_nodes check spare),
        layout!("start", "Emitter", emit::Constants,
            step first colour count place distance axis cap faces scale below_x below_y rows width height spare factors),
        layout!("photons", "Job", shoot::Job, slots rounds spare units),
        layout!("paths", "Job", path::Job,
            resolution first columns count number pixel rays slots steps background images slot end),
        layout!("paths", "Image", path::Image, pixel place),
        layout!("map", "Map", map::Entry, width height channels values sums spare),
        layout!("angular", "Job", angular::Job, n order h first eye inner count spare),
        layout!("camera", "View", camera::View,
            passing depth passing_x pixel passing_y width ahead column ahead_x row ahead_y spare),
        layout!("gather_ray", "Job", gather::Job,
            rays samples steps begin lights pixels maps finer channels sky stride),
        layout!("gather_ray", "Sums", gather::Sums, cell t next column order1 part source light over at width),
        layout!("gather_mean", "Pixel", gather::Pixel,
            order1 spare transmittance spare_too background spare_again emitted spare_at_last source),
        layout!("probe", "Inputs", Inputs, a b w),
    ]
}

#[test]
fn structs_lie_in_memory_as_in_rust() {
    for (file, name, rust, size) in layouts() {
        let text = read(file).expect("it is there");
        let start = text.find(&format!("struct {name} {{")).unwrap_or_else(|| panic!("{file} has no {name}"));
        let end = start + text[start..].find("\n}").expect("it ends");
        let module = naga::front::wgsl::parse_str(&text[start..end + 2]).expect("it is valid");
        let (_, found) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name)).expect("it is there");
        let naga::TypeInner::Struct { members, span } = &found.inner else { panic!("{name} is no struct") };
        let shader: Vec<(&str, usize)> =
            members.iter().map(|m| (m.name.as_deref().unwrap_or_default(), m.offset as usize)).collect();
        assert_eq!((shader, *span as usize), (rust, size), "{name} of {file}.wgsl");
    }
}

#[test]
fn counters_are_numbered_as_in_rust() {
    let text = read("counters").expect("it is there");
    let number = |name: &str| -> usize {
        let line = text.lines().find_map(|line| line.strip_prefix(&format!("const {name} = "))).expect(name);
        line.trim_end_matches("u;").parse().expect(name)
    };
    let places = [
        ("COPIES", shoot::COPIES),
        ("WORDS", shoot::WORDS),
        ("COLLISIONS", shoot::COLLISIONS),
        ("FINISHED", shoot::FINISHED),
        ("MISSED", Share::Missed.index()),
        ("UNSCATTERED", Share::Unscattered.index()),
        ("ABSORBED", Share::Absorbed.index()),
        ("TRUNCATED", Share::Truncated.index()),
        ("LOST", Share::Roulette.index()),
        ("ESCAPED", EXIT_FACES[0].index()),
    ];
    for (name, place) in places {
        assert_eq!(number(name), place, "{name}");
    }
    // Two words for each share and channel come before all else.
    assert_eq!(shoot::COLLISIONS, 2 * 3 * Share::COUNT);
}
