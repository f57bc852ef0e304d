// Spectra of three channels.

alias Spectrum = vec3<f32>;
const CHANNELS = 3u;

// The channels that there are of three.
fn spectrum(rgb: vec3<f32>) -> Spectrum {
    return rgb;
}

// Three channels.
fn rgb(s: Spectrum) -> vec3<f32> {
    return s;
}

// One channel.
fn channel(s: Spectrum, c: u32) -> f32 {
    return s[c];
}

// The largest channel, 0 at least.
fn largest(s: Spectrum) -> f32 {
    return max(max(max(s.x, 0.0), s.y), s.z);
}

// Exponentials by channel.
fn expos(s: Spectrum) -> Spectrum {
    return vec3(expo(s.x), expo(s.y), expo(s.z));
}

// Mean transmittances by channel.
fn mean_transmittances(s: Spectrum) -> Spectrum {
    return vec3(mean_transmittance(s.x), mean_transmittance(s.y), mean_transmittance(s.z));
}
