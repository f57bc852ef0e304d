//! The WGSL files, compiled in, and which of them make a kernel.

use super::kernel::Source;
use crate::error::{Error, Result};
use std::collections::HashSet;

macro_rules! shaders {
    ($list:ident: $($name:literal)*) => {
        /// Names and texts.
        pub const $list: &[(&str, &str)] = &[
            $(($name, include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders/", $name, ".wgsl"))),)*
        ];
    };
}

shaders! {
    ALL:
    "accept_all"
    "accept_some"
    "albedo_constant"
    "albedo_voxels"
    "angular"
    "angular_eye"
    "angular_harmonics"
    "angular_nothing"
    "backdrop_constant"
    "backdrop_maps"
    "camera"
    "camera_orthographic"
    "camera_perspective"
    "cells_constant"
    "cells_linear"
    "cells_nearest"
    "channels_1"
    "channels_3"
    "connect"
    "counters"
    "density_constant"
    "density_voxels"
    "deposit"
    "edge_ball"
    "edge_box"
    "emission_1"
    "emission_3"
    "emits"
    "emits_nothing"
    "emitted_chromatic"
    "emitted_grey"
    "emitted_none"
    "emitted_rays"
    "end_fate"
    "end_nothing"
    "eye"
    "face"
    "first_chromatic"
    "first_grey"
    "flight"
    "flight_state"
    "flights"
    "flights_cells"
    "flights_one"
    "frame"
    "gather"
    "gather_close"
    "gather_glow"
    "gather_lit"
    "gather_mean"
    "gather_ray"
    "glow"
    "glow_linear"
    "glow_nearest"
    "harmonics"
    "integral"
    "interpolate"
    "light"
    "line"
    "lookup"
    "lookup_linear"
    "lookup_nearest"
    "map"
    "maps_none"
    "maps_some"
    "march_constant"
    "march_linear"
    "march_nearest"
    "march_voxels"
    "near"
    "near_lights"
    "near_none"
    "path"
    "path_flights"
    "path_tracker"
    "paths"
    "phase"
    "phase_hg"
    "phase_isotropic"
    "phase_rayleigh"
    "phase_tabulated"
    "photons"
    "primary"
    "probe"
    "reach_constant"
    "reach_voxels"
    "real"
    "rng"
    "roulette"
    "score_deposit"
    "score_nothing"
    "shoot"
    "shoot_one"
    "single"
    "skip_blocks"
    "skip_none"
    "source0_none"
    "source0_voxels"
    "source_none"
    "source_voxels"
    "start"
    "start_directional"
    "start_environment"
    "start_first"
    "start_map"
    "start_medium"
    "start_pencil"
    "start_point"
    "table"
    "tables"
    "tally"
    "tally_parts"
    "tally_whole"
    "tracker_analytic"
    "tracker_march"
    "tracker_woodcock"
    "turn_isotropic"
    "turn_phase"
    "way"
    "weights_chromatic"
    "weights_grey"
    "wide"
}

#[cfg(test)]
shaders! { TESTS: "tests/glow" "tests/map" }
#[cfg(not(test))]
shaders! { TESTS: }

/// Files of every kernel.
pub const COMMON: &[&str] =
    &["tables", "real", "wide", "rng", "line", "lookup", "integral", "flight", "frame", "phase"];

/// Files of which the kind of scene chooses one from each row.
pub const KINDS: &[&str] = &[
    "channels_1 | channels_3",
    "edge_ball | edge_box",
    "lookup_linear | lookup_nearest",
    "density_constant | density_voxels",
    "albedo_constant | albedo_voxels",
    "phase_isotropic | phase_rayleigh | phase_hg | phase_tabulated",
];

/// What is chosen by the emitter of photons.
const STARTS: &str = "start_point | start_pencil | start_directional | start_environment | start_first table light | \
                      start_medium table emission_1 | start_medium table emission_3 | start_map table map";
/// What is chosen by what they are to leave in the voxels.
const ANGULAR: &str = "angular_eye | angular_harmonics | angular_nothing";
/// Whether tallies fit into one buffer.
const TALLIES: &str = "tally_whole | tally_parts";
/// Whether tests watch photons.
const ENDS: &str = "end_fate | end_nothing";

/// What paths are chosen by, however they fly.
const REACHES: &str = "reach_constant | reach_voxels";
const NEARS: &str = "near_none | near_lights";
const SKIES: &str = "maps_none | maps_some map";
/// What the medium emits.
const EMISSIONS: &str = "emission_1 | emission_3";
const GLOWS: &str = "glow_linear | glow_nearest";

/// The kernels: what each holds besides, one choice from each row. The first file holds `main`.
pub const KERNELS: &[&[&str]] = &[
    &["single light"],
    &["near light"],
    &[
        "shoot flights flight_state weights_grey face eye roulette photons counters tally deposit harmonics start",
        "flights_cells | flights_one",
        "turn_isotropic | turn_phase",
        "accept_all | accept_some",
        STARTS,
        ANGULAR,
        ENDS,
        TALLIES,
    ],
    &[
        "shoot_one way flight_state face eye roulette photons counters tally deposit harmonics start",
        "weights_chromatic | weights_grey",
        "score_deposit | score_nothing",
        "tracker_woodcock | tracker_analytic | tracker_march march_constant march_nearest | \
         tracker_march march_voxels march_nearest | tracker_march march_voxels march_linear",
        STARTS,
        ANGULAR,
        ENDS,
        TALLIES,
    ],
    &[
        "path path_flights flights paths primary camera connect light flight_state roulette first_grey weights_grey \
         emits_nothing",
        "flights_cells | flights_one",
        "turn_isotropic | turn_phase",
        "accept_all | accept_some",
        REACHES,
        NEARS,
        SKIES,
    ],
    &[
        "path path_tracker paths primary camera connect light flight_state face roulette way score_nothing",
        "weights_chromatic first_chromatic emits_nothing | weights_grey first_grey emits_nothing | \
         weights_chromatic first_chromatic emits emitted_chromatic emission_1 | \
         weights_chromatic first_chromatic emits emitted_chromatic emission_3 | \
         weights_grey first_grey emits emitted_grey emission_1 | weights_grey first_grey emits emitted_grey emission_3",
        "tracker_woodcock | tracker_analytic | tracker_march march_constant march_nearest | \
         tracker_march march_voxels march_nearest | tracker_march march_voxels march_linear",
        REACHES,
        NEARS,
        SKIES,
    ],
    &[
        "gather gather_ray gather_close gather_lit camera interpolate light",
        "camera_perspective | camera_orthographic",
        "cells_constant | cells_linear | cells_nearest",
        "source_voxels | source_none",
        "source0_voxels | source0_none",
        "skip_blocks | skip_none",
    ],
    &["angular eye harmonics"],
    &["gather_glow gather_ray camera emitted_rays glow", EMISSIONS, GLOWS],
    &[
        "gather_mean gather_ray camera",
        "emitted_rays glow | emitted_none",
        EMISSIONS,
        GLOWS,
        "backdrop_maps map | backdrop_constant",
    ],
];

/// Files that no scene asks for together.
const NEVER: &[(&str, &str)] = &[
    ("weights_chromatic", "channels_1"),
    ("emission_3", "channels_1"),
    ("march_constant", "density_voxels"),
    ("march_voxels", "density_constant"),
    ("march_linear", "lookup_nearest"),
    ("reach_constant", "density_voxels"),
    ("reach_voxels", "density_constant"),
    ("glow_linear", "lookup_nearest"),
    ("glow_nearest", "lookup_linear"),
    ("cells_constant", "density_voxels"),
    ("cells_linear", "density_constant"),
    ("cells_linear", "lookup_nearest"),
    ("cells_nearest", "density_constant"),
    ("cells_nearest", "lookup_linear"),
];

/// All kernels, each for so many kinds of scene that any two choices that may meet do meet: what is missing or clashes, does
/// so between two.
pub fn kernels() -> Vec<Source> {
    let mut kernels = Vec::new();
    for rows in KERNELS {
        let rows: Vec<Vec<&str>> =
            rows.iter().chain(KINDS).map(|row| row.split('|').map(str::trim).collect()).collect();
        let mut met = HashSet::new();
        for number in 0..rows.iter().map(Vec::len).product() {
            let mut rest: usize = number;
            let mut chosen = Vec::with_capacity(rows.len());
            for row in &rows {
                chosen.push(row[rest % row.len()]);
                rest /= row.len();
            }
            let news = chosen.iter().enumerate().flat_map(|(k, &a)| chosen[..k].iter().map(move |&b| (a, b)));
            if news.clone().all(|pair| met.contains(&pair)) {
                continue;
            }
            let files: Vec<&'static str> = chosen.iter().flat_map(|choice| choice.split_whitespace()).collect();
            if NEVER.iter().all(|(a, b)| !files.contains(a) || !files.contains(b)) {
                met.extend(news);
                kernels.push(Source::new(files.into_iter().chain(COMMON.iter().copied())));
            }
        }
    }
    kernels
}

/// The text of a file.
pub fn read(name: &str) -> Result<String> {
    let found = ALL.iter().chain(TESTS).find(|(one, _)| *one == name);
    found.map(|(_, text)| (*text).to_string()).ok_or_else(|| Error::Internal(format!("there is no shader {name:?}")))
}
