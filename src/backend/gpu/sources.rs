//! The WGSL files, compiled in, and which of them make a kernel.

use super::kernel::Source;
use crate::error::{Error, Result};
use std::collections::HashSet;

macro_rules! shaders {
    ($($name:literal)*) => {
        /// Names and texts.
        pub const ALL: &[(&str, &str)] = &[
            $(($name, include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders/", $name, ".wgsl"))),)*
        ];
    };
}

shaders! {
    "accept_all" "accept_some" "albedo_constant" "albedo_voxels" "angular_eye" "angular_harmonics" "angular_nothing"
    "channels_1" "channels_3" "counters" "density_constant" "density_voxels" "deposit" "edge_ball" "edge_box"
    "end_fate" "end_nothing" "flight" "flight_state" "flights" "flights_cells" "flights_one" "frame" "harmonics"
    "light" "line" "lookup" "lookup_linear" "lookup_nearest" "march_constant" "march_linear" "march_nearest"
    "march_voxels" "phase" "phase_hg" "phase_isotropic" "phase_rayleigh" "phase_tabulated" "photons" "probe" "real" "rng"
    "roulette" "score_deposit" "score_nothing" "shoot" "shoot_one" "start" "start_directional" "start_environment"
    "start_first" "start_medium" "start_pencil" "start_point" "store_chromatic" "store_grey" "table" "tables"
    "tally" "tracker_analytic" "tracker_march" "tracker_woodcock" "turn_isotropic" "turn_phase" "way"
    "weights_chromatic" "weights_grey" "wide"
}

/// Files of every kernel.
pub const COMMON: &[&str] = &["tables", "real", "wide", "rng", "line", "lookup", "flight", "frame", "phase"];

/// Files of which the kind of scene chooses one from each list.
pub const KINDS: &[&[&str]] = &[
    &["channels_1", "channels_3"],
    &["edge_ball", "edge_box"],
    &["lookup_linear", "lookup_nearest"],
    &["density_constant", "density_voxels"],
    &["albedo_constant", "albedo_voxels"],
    &["phase_isotropic", "phase_rayleigh", "phase_hg", "phase_tabulated"],
];

/// The kernels: for each the files besides, one from each list; the first holds `main`.
pub const KERNELS: &[&[&[&str]]] = &[&[
    &["shoot"],
    &["flights"],
    &["photons"],
    &["counters"],
    &["tally"],
    &["deposit"],
    &["harmonics"],
    &["table"],
    &["light"],
    &["start"],
    &["flights_cells", "flights_one"],
    &["turn_isotropic", "turn_phase"],
    &["accept_all", "accept_some"],
    &["end_fate", "end_nothing"],
    &["angular_eye", "angular_harmonics", "angular_nothing"],
    &["start_first", "start_medium", "start_pencil", "start_point", "start_directional", "start_environment"],
]];

/// All kernels, each for so many kinds of scene that any two files that may meet do meet: what is missing or clashes, does
/// so between two.
pub fn kernels() -> Vec<Source> {
    let mut kernels = Vec::new();
    for lists in KERNELS {
        let (fixed, choices): (Vec<&[&str]>, Vec<_>) = lists.iter().chain(KINDS).partition(|list| list.len() == 1);
        let fixed: Vec<&'static str> = fixed.concat();
        let mut met = HashSet::new();
        for number in 0..choices.iter().map(|list| list.len()).product() {
            let mut rest: usize = number;
            let mut files = Vec::with_capacity(choices.len());
            for list in &choices {
                files.push(list[rest % list.len()]);
                rest /= list.len();
            }
            let pairs = files.iter().flat_map(|&a| files.iter().map(move |&b| (a, b)));
            if pairs.fold(false, |new, pair| met.insert(pair) || new) {
                kernels.push(Source::new(fixed.iter().chain(&files).chain(COMMON).copied()));
            }
        }
    }
    kernels
}

/// The text of a file.
pub fn read(name: &str) -> Result<String> {
    if let Ok(folder) = std::env::var("MCRT_SHADERS") {
        let path = std::path::Path::new(&folder).join(format!("{name}.wgsl"));
        return std::fs::read_to_string(&path).map_err(|e| Error::Internal(format!("{}: {e}", path.display())));
    }
    let found = ALL.iter().find(|(one, _)| *one == name);
    found.map(|(_, text)| (*text).to_string()).ok_or_else(|| Error::Internal(format!("there is no shader {name:?}")))
}
