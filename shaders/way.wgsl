// From one point of a photon's way to its next collision, or out of the box: what all trackers share.

// How a flight went on: to a collision, out of the medium, or so far that it pauses.
const COLLIDED = 0u;
const LEFT = 1u;
const FLYING = 2u;

// Steps of a tracker before a flight pauses.
override STEPS: u32 = 64u;

struct Way {
    // Where the flight begins, or goes on; then where it ended.
    p: vec3<f32>,
    // Voxels per length.
    v: vec3<f32>,
    // What is left of the free flight [mean free paths]; negative where none was drawn yet.
    free: f32,
    // Random words of the next event.
    word: vec4<u32>,
    // The face that it left through: -x +x -y +y -z +z.
    face: u32,
}

// The direction of flight and scatterings so far, for what scores.
var<private> score_direction: vec3<f32>;
var<private> score_order: u32;

// Which part of a piece a random point of it lies behind.
fn random_part(word: u32) -> f32 {
    return rounding((word << 16u) | (word >> 16u));
}

// The next of a sequence of words, for scores along a line.
fn next_word(word: u32) -> u32 {
    return word * 747796405u + 2891336453u;
}

// A point of the box, just below its upper faces.
fn within(p: vec3<f32>) -> vec3<f32> {
    return clamp(p, vec3(0.0), vec3<f32>(scene.n) * (1.0 - 6e-8));
}
