//! The GPU backend: the heavy stages of a plan as WGSL compute kernels, on Vulkan, Metal or DirectX 12.
//!
//! Each kernel is a list of small files from `shaders/`, one formula beside its Rust twin, and the values of its `override`
//! constants: the plan picks both, so that a kernel holds what its scene needs. Random numbers, and the order in which a
//! photon draws them, are those of the CPU.

pub mod adapter;
pub mod angular;
pub mod camera;
pub mod device;
pub mod emit;
pub mod gather;
pub mod glow;
pub mod kernel;
pub mod lights;
pub mod map;
mod pace;
pub mod path;
pub mod probe;
pub mod scene;
pub mod shoot;
pub mod sources;
pub mod tally;
pub mod tracker;

pub use device::Gpu;
pub use sources::kernels;
