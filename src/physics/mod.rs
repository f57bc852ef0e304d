//! Pure, allocation-free formulas, generic over [`Real`]: `f64` is the truth, `f32` what kernels run.
//! Randomness enters as uniform numbers `xi`; nothing here knows of scenes, grids or threads.

pub mod flight;
pub mod frame;
pub mod harmonics;
pub mod lattice;
pub mod phase;
pub mod real;
pub mod rng;
pub mod solid_angle;

pub use phase::Phase;
pub use real::Real;
