// A photon on its flight.

struct Flight {
    // Voxel coordinates, and unit direction.
    p: vec3<f32>,
    d: vec3<f32>,
    // The next tentative collision.
    q: vec3<f32>,
    // Whose random numbers it draws, and blocks of random words used.
    index: vec2<u32>,
    block: u32,
    // Random words of this event.
    word: vec4<u32>,
    // A uniform number for the scattering angle.
    xi: f32,
    // What is left of the free flight, in optical depths of the majorant.
    depth: f32,
    // 1 / majorant where it is [length].
    free_path: f32,
    // Cell of the majorant grid.
    at: vec3<i32>,
}
