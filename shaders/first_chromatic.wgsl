// First collisions on view rays where extinctions differ.

// The channel that decides where a path begins.
fn first_hero(word: u32) -> u32 {
    return mul_hi(word, 3u);
}

// The weights of a path at its first collision.
fn first_weights(path: ptr<function, Path>, hero: u32, column: f32) -> Weights {
    var w = Weights((*path).opacity / (*path).top, vec3(1.0), hero);
    observe(&w, vec3(first_chance(path, 0u, column), first_chance(path, 1u, column), first_chance(path, 2u, column)));
    return w;
}

// The weights of a path that sets out where its view ray enters.
fn outside_weights(f: ptr<function, Flight>) -> Weights {
    return new_weights(vec3(1.0), next_words(f).x);
}

// The density of first collisions per column density at a given one, the mean over the channels that may decide.
fn first_density(path: ptr<function, Path>, column: f32) -> f32 {
    return (first_chance(path, 0u, column) + first_chance(path, 1u, column) + first_chance(path, 2u, column)) / 3.0;
}
