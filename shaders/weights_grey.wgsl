// Weights of photons whose channels have the same extinction.

// Whether a random word chooses the channel that decides on flights.
const DRAWS_HERO = false;

struct Weights {
    value: Spectrum,
}

// A photon that has not flown yet.
fn new_weights(value: Spectrum, word: u32) -> Weights {
    return Weights(value);
}

// The unbiased weight in each channel.
fn unbiased(w: Weights) -> Spectrum {
    return w.value;
}

// Whether a tentative collision is real, that is with the chance `accept`.
fn decide(w: ptr<function, Weights>, accept: f32, xi: f32) -> bool {
    return xi <= accept;
}

// The extinction per density that decides on flights.
fn deciding(w: Weights) -> f32 {
    return scene.top_extinction;
}

// The weights after a column density without a collision.
fn survived(w: Weights, column: f32) -> Weights {
    return w;
}

// The weights after a collision at a place that the optical depth decided.
fn collided(w: Weights) -> Weights {
    return w;
}
