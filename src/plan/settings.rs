//! What the user asks for, apart from the scene.

use crate::error::{Error, Result, scene_error};
use crate::physics::harmonics::MAX_ORDER;
use std::fmt;
use std::str::FromStr;

/// How the answer is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Deterministic: orders 0 and 1.
    Single,
    /// Photons deposit orders >= 2 in voxels, a gather makes images.
    Photon,
    /// Paths from the camera, images only.
    Path,
}

/// How free flights are sampled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tracker {
    /// Null collisions against the majorant grid.
    Woodcock,
    /// Inversion of the running optical depth, voxel by voxel.
    March,
    /// Closed form, homogeneous media only.
    Analytic,
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Method::Single => "single",
            Method::Photon => "photon",
            Method::Path => "path",
        })
    }
}

impl FromStr for Method {
    type Err = Error;
    fn from_str(s: &str) -> Result<Self> {
        match s {
            "single" => Ok(Method::Single),
            "photon" => Ok(Method::Photon),
            "path" => Ok(Method::Path),
            _ => {
                scene_error(format!("method = {s:?} is not allowed; \"auto\", \"single\", \"photon\" or \"path\" are"))
            }
        }
    }
}

impl FromStr for Tracker {
    type Err = Error;
    fn from_str(s: &str) -> Result<Self> {
        match s {
            "woodcock" => Ok(Tracker::Woodcock),
            "march" => Ok(Tracker::March),
            "analytic" => Ok(Tracker::Analytic),
            _ => scene_error(format!(
                "tracker = {s:?} is not allowed; \"auto\", \"woodcock\", \"march\" or \"analytic\" are"
            )),
        }
    }
}

/// How the radiance that scatters in a voxel of an anisotropic medium is recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Angular {
    /// Towards the eye of the run.
    Eye,
    /// In spherical harmonics, for every eye: of the given order, or of one that the plan picks.
    Harmonics(Option<usize>),
}

/// The instructions that photons are walked with. All but the first walk them in lanes, with the same bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Simd {
    /// One photon after the other: the truth that lanes are compared with.
    Scalar,
    /// Lanes in what every processor of the architecture has (SSE2, NEON).
    Baseline,
    /// Lanes in AVX2.
    Avx2,
    /// Lanes in AVX-512 F, BW, CD, DQ and VL.
    Avx512,
}

impl Simd {
    /// All with their names.
    pub const ALL: [(Simd, &'static str); 4] =
        [(Simd::Scalar, "scalar"), (Simd::Baseline, "baseline"), (Simd::Avx2, "avx2"), (Simd::Avx512, "avx512")];
}

impl fmt::Display for Simd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(Simd::ALL[*self as usize].1)
    }
}

impl FromStr for Simd {
    type Err = Error;
    fn from_str(s: &str) -> Result<Self> {
        match Simd::ALL.iter().find(|(_, name)| *name == s) {
            Some((simd, _)) => Ok(*simd),
            None => scene_error(format!(
                "MCRT_SIMD = {s:?} is not allowed; \"scalar\", \"baseline\", \"avx2\" or \"avx512\" are"
            )),
        }
    }
}

/// The adapter that runs a plan, and what it allows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Adapter {
    /// Its name.
    pub name: String,
    /// Whether a processor plays the GPU.
    pub software: bool,
    /// The largest buffer that a kernel may see at once [bytes].
    pub binding: u64,
    /// The largest extent of a volume along an axis [voxels].
    pub extent: u32,
}

/// The settings of a run; `None` leaves the choice to the plan.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Method, `None` for the cheapest that is good enough.
    pub method: Option<Method>,
    /// Tracker, `None` for the cheapest.
    pub tracker: Option<Tracker>,
    /// Number of photons.
    pub photons: Option<u64>,
    /// Paths per pixel.
    pub spp: Option<u64>,
    /// Relative error at which the run stops.
    pub target_error: Option<f64>,
    /// Seconds after which the run stops.
    pub time_limit: Option<f64>,
    /// Highest scattering order.
    pub max_scatterings: Option<u32>,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Worker threads; `None` for all cores.
    pub threads: Option<usize>,
    /// Whether replicate volumes for pixel errors are kept.
    pub errors: bool,
    /// Whether the fluence of each voxel is wanted.
    pub fluence: bool,
    /// Whether the radiance of each voxel is wanted.
    pub radiance: bool,
    /// Whether images are wanted.
    pub image: bool,
    /// Run even if memory seems too small.
    pub force: bool,
    /// How radiance is recorded in anisotropic media.
    pub angular: Angular,
    /// Instructions to walk photons with; `None` for the best that the machine has.
    pub simd: Option<Simd>,
    /// The adapter that runs it, `None` for the CPU.
    pub adapter: Option<Adapter>,
    /// Why that, in a few words.
    pub chosen: &'static str,
    /// Whether `target_error` is over voxels rather than pixels.
    pub over_voxels: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            method: None,
            tracker: None,
            photons: None,
            spp: None,
            target_error: None,
            time_limit: None,
            max_scatterings: None,
            seed: 0,
            threads: None,
            errors: true,
            fluence: true,
            radiance: true,
            image: true,
            force: false,
            angular: Angular::Eye,
            simd: None,
            adapter: None,
            chosen: "asked for",
            over_voxels: false,
        }
    }
}

impl Settings {
    /// Checks the ranges.
    pub fn validate(&self) -> Result<()> {
        if let Some(n) = self.photons
            && !(1..=1_000_000_000_000_000).contains(&n)
        {
            return scene_error(format!("photons = {n} is not allowed; 1 to 1e15 are"));
        }
        if let Some(n) = self.spp
            && !(1..=1_000_000_000).contains(&n)
        {
            return scene_error(format!("spp = {n} is not allowed; 1 to 1e9 are"));
        }
        match self.method {
            Some(Method::Path) if self.photons.is_some() => {
                return scene_error("photons is given, but method = \"path\" shoots none; use spp (paths per pixel)");
            }
            Some(Method::Single | Method::Photon) if self.spp.is_some() => {
                return scene_error("spp is for method = \"path\"; the other methods take photons");
            }
            _ => {}
        }
        if let Some(e) = self.target_error
            && !(e > 0.0 && e.is_finite())
        {
            return scene_error(format!("target_error = {e} is not allowed; it must be positive"));
        }
        if let Some(t) = self.time_limit
            && !(t > 0.0)
        {
            return scene_error(format!("time_limit = {t} is not allowed; it must be positive (seconds)"));
        }
        if let Some(t) = self.threads
            && !(1..=4096).contains(&t)
        {
            return scene_error(format!("threads = {t} is not allowed; 1 to 4096 are"));
        }
        if let Angular::Harmonics(Some(n)) = self.angular
            && n > MAX_ORDER
        {
            return scene_error(format!("angular = {n} is not allowed; orders 0 to {MAX_ORDER} are"));
        }
        Ok(())
    }
}
