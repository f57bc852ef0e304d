// What a photon leaves where it is: its fluence, and what of it would scatter towards the eye or into harmonics.

// The layer of the fluence of incident order 0, of the inner orders and of the last, or NOWHERE.
override PLAIN_FIRST: u32 = 0xffffffffu;
override PLAIN_INNER: u32 = 0xffffffffu;
override PLAIN_LAST: u32 = 0xffffffffu;
// The same of what has a direction.
override ANGULAR_FIRST: u32 = 0xffffffffu;
override ANGULAR_INNER: u32 = 0xffffffffu;
override ANGULAR_LAST: u32 = 0xffffffffu;
// The layer of what is absorbed, of all orders whose fluence is kept.
override ABSORBED_FIRST: u32 = 0xffffffffu;

const NOWHERE = 0xffffffffu;

// The first bin of a layer; one of spherical harmonics counts as many as they are.
fn first_bin(layer: u32) -> u32 {
    return layer * u32(scene.n.x * scene.n.y * scene.n.z) * CHANNELS;
}

// The layer of the fluence after `order` scatterings.
fn plain_of(order: u32) -> u32 {
    let inner = order > 0u && order != scene.last;
    return select(select(PLAIN_LAST, PLAIN_FIRST, order == 0u), PLAIN_INNER, inner);
}

// Whether what is absorbed is kept too.
fn absorbs(order: u32) -> bool {
    return ABSORBED_FIRST != NOWHERE && plain_of(order) != NOWHERE;
}

// Adds what of `units` is absorbed at p, a point of the given density in a voxel.
fn deposit_absorbed(voxel: u32, p: vec3<f32>, density: f32, units: Spectrum, xi: f32) {
    let absorbed = units * relative_absorption(p, density);
    for (var c = 0u; c < CHANNELS; c++) {
        add_units(first_bin(ABSORBED_FIRST) + voxel * CHANNELS + c, channel(absorbed, c), xi);
    }
}

// Adds `units` (weight times length) at p in a voxel, on the way along d, after `order` scatterings.
fn deposit(voxel: u32, p: vec3<f32>, d: vec3<f32>, order: u32, units: Spectrum, xi: f32) {
    let inner = order > 0u && order != scene.last;
    let plain = plain_of(order);
    if plain != NOWHERE {
        for (var c = 0u; c < CHANNELS; c++) {
            add_units(first_bin(plain) + voxel * CHANNELS + c, channel(units, c), xi);
        }
    }
    let angular = select(select(ANGULAR_LAST, ANGULAR_FIRST, order == 0u), ANGULAR_INNER, inner);
    if angular != NOWHERE {
        deposit_angular(first_bin(angular), voxel, p, d, units, xi);
    }
}
