//! Monte Carlo radiative transport in voxel volumes.
//!
//! The equation, for the radiance L [W/(m^2 sr)] at x along w, with sigma_s = albedo * sigma_t and the phase function P:
//!
//! ```text
//! w . grad L = -sigma_t L + sigma_s * integral P(w', w) L(x, w') dw' + L_e
//! ```
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | `sigma_t` | extinction = `extinction` * density | 1/length |
//! | albedo | sigma_s / sigma_t | 1 |
//! | P | phase function | 1/sr |
//! | L_e | source term (emission) | W/(volume sr) |
//! | fluence | integral of L over directions | W/area |
//! | source (J) | integral of P L over directions | W/(area sr) |
//! | radiance of a voxel | albedo * J towards the eye | W/(area sr) |
//!
//! The pipeline, the same in Python:
//!
//! ```text
//! let scene = Scene::new(medium, lights, camera);   // parsed at the border, hence valid
//! let plan = Plan::new(&scene, &settings)?;         // pure data: which kernels, which tables, why
//! let result = backend::run::run(&plan, &device, &control)?; // the only effect
//! let image = backend::cpu::gather::image(...)?;    // any camera, same photons
//! ```
//!
//! Imports run one way: physics <- scene <- plan <- backend <- python.

pub mod backend;
pub mod error;
pub mod physics;
pub mod plan;
pub mod result;
pub mod scene;
pub mod tally;

#[cfg(feature = "python")]
mod python;

pub use error::{Error, Result};
pub use plan::{Plan, Settings};
pub use scene::Scene;

// Tests of what is public, within the library, for it takes as long to compile once more.
#[cfg(test)]
extern crate self as mcrt;
#[cfg(test)]
#[path = "../tests/rust.rs"]
mod tests;
