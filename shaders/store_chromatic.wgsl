// Whether a random word chooses the channel that decides on flights.
const DRAWS_HERO = true;

// The weights of a photon under way.
fn load_weights(photon: Photon) -> Weights {
    return Weights(photon.weight, photon.absorbed, photon.hero);
}

fn store_weights(photon: ptr<function, Photon>, w: Weights) {
    (*photon).weight = w.value;
    (*photon).absorbed = w.chance;
    (*photon).hero = w.hero;
}
