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
    "albedo_constant" "albedo_voxels" "channels_1" "channels_3" "columns" "density_constant" "density_voxels" "edge_ball" "edge_box"
    "flight" "frame" "harmonics" "light" "line" "lookup" "lookup_linear" "lookup_nearest" "phase" "phase_hg"
    "phase_isotropic" "phase_rayleigh" "phase_tabulated" "probe" "real" "rng" "tables" "wide"
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
pub const KERNELS: &[&[&[&str]]] = &[&[&["columns"], &["light"]]];

/// Kernels in which every file meets every other that it may be asked to meet: what is missing or clashes, does so
/// between two.
pub fn kernels() -> Vec<Source> {
    let mut kernels = Vec::new();
    for lists in KERNELS {
        let mut met = HashSet::new();
        let lists: Vec<&[&'static str]> = lists.iter().chain(KINDS).copied().collect();
        let combinations: usize = lists.iter().map(|list| list.len()).product();
        for mut at in 0..combinations {
            let files: Vec<&'static str> = lists
                .iter()
                .map(|list| {
                    let file = list[at % list.len()];
                    at /= list.len();
                    file
                })
                .collect();
            let pairs: Vec<_> = files.iter().flat_map(|&a| files.iter().map(move |&b| (a, b))).collect();
            // Each pair is to be seen, whatever came before.
            let news = pairs.into_iter().filter(|pair| met.insert(*pair)).count();
            if news > 0 {
                kernels.push(Source::new(files.into_iter().chain(COMMON.iter().copied())));
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
