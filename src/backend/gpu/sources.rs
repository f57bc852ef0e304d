//! The WGSL files, compiled in.

use crate::error::{Error, Result};

macro_rules! shaders {
    ($list:ident: $($name:literal)*) => {
        /// Names and texts.
        const $list: &[(&str, &str)] = &[
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
    "gather_mean"
    "gather_ray"
    "glow"
    "glow_linear"
    "glow_nearest"
    "harmonics"
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
    "reach_constant"
    "reach_linear"
    "reach_nearest"
    "real"
    "rng"
    "roulette"
    "score_deposit"
    "score_nothing"
    "shoot"
    "shoot_one"
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
    "store_chromatic"
    "store_grey"
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

/// The text of a file.
pub fn read(name: &str) -> Result<String> {
    if let Ok(folder) = std::env::var("MCRT_SHADERS") {
        let path = std::path::Path::new(&folder).join(format!("{name}.wgsl"));
        return std::fs::read_to_string(&path).map_err(|e| Error::Internal(format!("{}: {e}", path.display())));
    }
    let found = ALL.iter().chain(TESTS).find(|(one, _)| *one == name);
    found.map(|(_, text)| (*text).to_string()).ok_or_else(|| Error::Internal(format!("there is no shader {name:?}")))
}
