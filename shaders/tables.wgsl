// What all kernels know of the scene.

struct Scene {
    // Voxels along x, y, z, and voxels per majorant cell and axis.
    n: vec3<i32>,
    block: i32,
    // Spacing, and 1 / majorant where there is one majorant [length].
    h: vec3<f32>,
    free_path: f32,
    // Voxels per length, and the largest extinction per density.
    inverse_h: vec3<f32>,
    top_extinction: f32,
    // Extinction per density by channel, and the density of a texel of 1.
    extinction: vec3<f32>,
    texel: f32,
    // Albedo by channel where it is constant, and the density where that is constant.
    albedo: vec3<f32>,
    constant: f32,
    // Extinction of each channel over the largest, and the albedo of a texel of 1.
    ratio: vec3<f32>,
    albedo_texel: f32,
    // Majorant cells along x, y, z, and the highest scattering order.
    cells: vec3<i32>,
    last: u32,
    // Where anisotropic media are recorded towards: a point in voxels (w = 1), or a direction (w = 0).
    eye: vec4<f32>,
    // The key of all random numbers.
    seed: vec2<u32>,
    // Column density behind which it is dark in all channels.
    enough: f32,
    // 1 / the largest density.
    per_density: f32,
    // Of Henyey and Greenstein's phase function: g, 1 - |g|, (1 - |g|)^2, (1 - g^2) / (4 pi).
    hg: vec4<f32>,
}

@group(0) @binding(0) var<uniform> scene: Scene;
