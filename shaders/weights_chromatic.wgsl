// Weights of photons whose channels differ in extinction. One channel (the hero) decides the flight, and the balance
// heuristic over the three that might have decided keeps every channel unbiased with bounded weights (Miller, Georgiev,
// Jarosz, A null-scattering path integral formulation of light transport, SIGGRAPH 2019).

// Whether a random word chooses the channel that decides on flights.
const DRAWS_HERO = true;

struct Weights {
    // Weight without the flights: what albedo, emission and roulette made of it.
    value: Spectrum,
    // Chance of the flights so far under each channel's extinction, over the mean of these chances.
    chance: Spectrum,
    hero: u32,
}

// A photon that has not flown yet; `word` chooses the hero.
fn new_weights(value: Spectrum, word: u32) -> Weights {
    return Weights(value, vec3(1.0), mul_hi(word, 3u));
}

// The unbiased weight in each channel.
fn unbiased(w: Weights) -> Spectrum {
    return w.value * w.chance;
}

// Takes in an event of the given chance (any common scale) under each channel.
fn observe(w: ptr<function, Weights>, chance: Spectrum) {
    let all = (*w).chance * chance;
    let sum = all.x + all.y + all.z;
    (*w).chance = all * (3.0 / max(sum, 1e-30));
}

// Whether a tentative collision is real: `accept` is the chance of a channel of the largest extinction.
fn decide(w: ptr<function, Weights>, accept: f32, xi: f32) -> bool {
    let real = xi <= accept * scene.ratio[(*w).hero];
    observe(w, select(max(1.0 - accept * scene.ratio, vec3(0.0)), scene.ratio, real));
    return real;
}

// The extinction per density that decides on flights.
fn deciding(w: Weights) -> f32 {
    return scene.extinction[w.hero];
}

// The weights after a column density without a collision: relative to the hero, whose own chance cancels; kept from
// overflow where others survive far better.
fn survived(w: Weights, column: f32) -> Weights {
    var after = w;
    observe(&after, expos(min((scene.extinction[w.hero] - scene.extinction) * column, vec3(60.0))));
    return after;
}

// The weights after a collision at a place that the optical depth decided.
fn collided(w: Weights) -> Weights {
    var after = w;
    observe(&after, scene.extinction / scene.extinction[w.hero]);
    return after;
}
