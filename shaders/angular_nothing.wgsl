// Isotropic media: the fluence says all.
fn deposit_angular(first: u32, voxel: u32, p: vec3<f32>, d: vec3<f32>, units: Spectrum, xi: f32) {}
