// First collisions on view rays where all channels have the same extinction.

// The channel that decides where a path begins.
fn first_hero(word: u32) -> u32 {
    return 0u;
}

// The weights of a path at its first collision.
fn first_weights(path: ptr<function, Path>, hero: u32, column: f32) -> Weights {
    return new_weights(spectrum((*path).opacity) / (*path).top, 0u);
}

// The weights of a path that sets out where its view ray enters.
fn outside_weights(f: ptr<function, Flight>) -> Weights {
    return new_weights(spectrum(vec3(1.0)), 0u);
}

// The density of first collisions per column density at a given one.
fn first_density(path: ptr<function, Path>, column: f32) -> f32 {
    return first_chance(path, 0u, column);
}
