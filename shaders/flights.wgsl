// Null-collision flights, one event after the other: four random words each. The free flight; the jitter of the density's
// one read, and two bits for roulette; the acceptance, whose position within the accepted part is again uniform and gives the
// scattering angle; the azimuth, and ten bits that extend the flight's word beyond 32 bits. All bits of the last word
// together round what the event leaves in the tallies.

// What the random numbers are for.
override PURPOSE: u32 = 0u;

// How a flight went on: to a tentative collision, out of the medium, or to a cell's edge, from where it is to go on.
const TENTATIVE = 0u;
const LEFT = 1u;
const FLYING = 2u;

// The next four words, and the free flight that they begin with: up to 28 mean free paths, from 32 bits and ten more.
fn draw_flight(f: ptr<function, Flight>) {
    let word = words(scene.seed, (*f).index, (*f).block, PURPOSE);
    (*f).word = word;
    (*f).block += 1u;
    let rest = (f32(word.w & 1023u) + 0.5) * (1.0 / 1024.0);
    (*f).depth = -ln((f32(word.x) + rest) * (1.0 / 4294967296.0));
    (*f).at = vec3(-1);
}

// The albedo at a real collision.
fn albedo_of(f: ptr<function, Flight>) -> Spectrum {
    return albedo_read((*f).p, words(scene.seed, (*f).index, (*f).block, PURPOSE + 1u).x);
}

// Whether roulette is survived.
fn survives(f: ptr<function, Flight>) -> bool {
    return ((*f).word.y >> 30u) == 0u;
}

// A part of a turn from the upper 22 bits.
fn azimuth(word: u32) -> f32 {
    return f32(word >> 10u) * (1.0 / 4194304.0);
}
