// A photon on its flight.

struct Flight {
    // Voxel coordinates, and a uniform number for the scattering angle.
    p: vec3<f32>,
    xi: f32,
    // Unit direction, and what is left of the free flight, in optical depths of the majorant.
    d: vec3<f32>,
    depth: f32,
    // The next tentative collision, and 1 / majorant where it is [length].
    q: vec3<f32>,
    free_path: f32,
    // Cell of the majorant grid, and blocks of random words used.
    at: vec3<i32>,
    block: u32,
    // Random words of this event.
    word: vec4<u32>,
    // Whose random numbers it draws.
    index: vec2<u32>,
}
