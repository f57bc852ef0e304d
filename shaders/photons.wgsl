// The photons that are under way: one for each slot, kept from dispatch to dispatch.

struct Photon {
    flight: Flight,
    weights: Weights,
    // What was absorbed of it so far.
    absorbed: Spectrum,
    // Its number in the batch, and scatterings so far.
    number: u32,
    order: u32,
    // What is to happen to it next.
    state: u32,
}

struct Job {
    // Photons under way at once, and rounds of events in this dispatch.
    slots: u32,
    rounds: u32,
    spare: vec2<u32>,
    // Units per weight and length, by channel.
    units: vec3<f32>,
}

@group(0) @binding(5) var<uniform> job: Job;
@group(0) @binding(21) var<storage, read_write> photons: array<Photon>;

// What is to happen to a slot: it is new; it has no photons left; it takes its next one; the start of that is searched for;
// it collides; it flies; it pauses within a flight.
const NEW = 0u;
const OVER = 1u;
const NEXT = 2u;
const STARTS = 3u;
const HITS = 4u;
const FLIGHT = 5u;
const PAUSED = 6u;

// The photon of a slot; a new one has its first before it.
fn photon_of(slot: u32) -> Photon {
    var photon = photons[slot];
    if photon.state == NEW {
        photon.number = slot;
        photon.state = NEXT;
    }
    return photon;
}

// Takes up the slot's next photon, if there is one.
fn take_next(photon: ptr<function, Photon>, f: ptr<function, Flight>) {
    (*f).index = add64(emitter.first, vec2((*photon).number, 0u));
    (*f).block = 0u;
    (*photon).absorbed = spectrum(vec3(0.0));
    (*photon).order = 0u;
    (*photon).state = select(OVER, STARTS, (*photon).number < emitter.count);
}

// Ends the slot's photon, what remains of which goes to a share; xi rounds.
fn finish(photon: ptr<function, Photon>, toll: ptr<function, Toll>, share: u32, xi: f32) {
    if share != ABSORBED && share != LOST {
        add_share((*toll).copy, share, unbiased((*photon).weights), xi);
    }
    add_taken(toll, (*photon).absorbed, xi);
    end((*photon).number, (*photon).order, share);
    (*toll).finished += 1u;
    (*photon).number += job.slots;
}
