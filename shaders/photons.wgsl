// The photons that are under way: one for each slot, kept from dispatch to dispatch.

struct Photon {
    p: vec3<f32>,
    // Scatterings so far.
    order: u32,
    d: vec3<f32>,
    // What is to happen to it next.
    state: u32,
    weight: vec3<f32>,
    // Its number in the batch.
    number: u32,
    // Until it ends: what was absorbed of it, or in media whose channels differ the chances of its flights.
    absorbed: vec3<f32>,
    // Blocks of random words used.
    block: u32,
    word: vec4<u32>,
    at: vec3<i32>,
    depth: f32,
    xi: f32,
    free_path: f32,
    // The channel that decides on flights.
    hero: u32,
    spare: u32,
}

struct Job {
    // Photons under way at once, and rounds of events in this dispatch.
    slots: u32,
    rounds: u32,
    // Units per weight and length.
    unit: f32,
    spare: u32,
}

@group(0) @binding(5) var<uniform> job: Job;
@group(0) @binding(21) var<storage, read_write> photons: array<Photon>;

// What is to happen to a photon: the slot is to take its next one, or has none left; its start is searched for; it
// collides; it flies; it pauses within a flight.
const NEXT = 0u;
const OVER = 1u;
const STARTS = 2u;
const HITS = 3u;
const FLIGHT = 4u;
const PAUSED = 5u;
