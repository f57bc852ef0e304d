// Whether a random word chooses the channel that decides on flights.
const DRAWS_HERO = false;

// The weights of a photon under way.
fn load_weights(photon: Photon) -> Weights {
    return Weights(spectrum(photon.weight));
}

fn store_weights(photon: ptr<function, Photon>, w: Weights) {
    (*photon).weight = rgb(w.value);
}
