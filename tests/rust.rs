//! Tests in Rust of what the library shows; those of what it hides stand beside it in `src`.

mod architecture;
mod gpu_path;
mod gpu_probe;
mod harmonics;
mod phase;
mod shaders;
