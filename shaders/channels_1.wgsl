// Spectra of one channel.

alias Spectrum = f32;
const CHANNELS = 1u;

// The channels that there are of three.
fn spectrum(rgb: vec3<f32>) -> Spectrum {
    return rgb.x;
}

// Three channels, of which those that there are not repeat the first.
fn rgb(s: Spectrum) -> vec3<f32> {
    return vec3(s);
}

// One channel.
fn channel(s: Spectrum, c: u32) -> f32 {
    return s;
}

// The largest channel, 0 at least.
fn largest(s: Spectrum) -> f32 {
    return max(s, 0.0);
}

// Exponentials by channel.
fn expos(s: Spectrum) -> Spectrum {
    return expo(s);
}

// Mean transmittances by channel.
fn mean_transmittances(s: Spectrum) -> Spectrum {
    return mean_transmittance(s);
}
