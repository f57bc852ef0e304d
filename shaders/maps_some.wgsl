// Maps of the sky: directions are drawn from them at vertices, and they are met on leaving the volume. Of each the balance
// heuristic leaves a part to either way of finding it.

override MAPS: u32 = 0u;

const HAS_MAPS = true;

// The purposes of the random numbers of maps begin here.
const SKY = 16777216u;

// What maps add at a vertex.
fn connect_maps(path: ptr<function, Path>, f: ptr<function, Flight>) {
    for (var i = 0u; i < MAPS; i++) {
        let light = under_map(i, (*f).p, (*f).d, connection_words(f, SKY + i));
        see(path, (*path).order, unbiased((*path).weights) * light);
    }
}

// The radiance of a map that is scattered along the path at a vertex, over the albedo there, from a direction drawn from
// the map.
fn under_map(map: u32, p: vec3<f32>, travel: vec3<f32>, word: vec4<u32>) -> Spectrum {
    let drawn = map_sample(map, unit(word.x), unit(word.y));
    let phase = phase_towards(-drawn.d, travel);
    if drawn.pdf <= 0.0 || phase <= 0.0 {
        return Spectrum(0.0);
    }
    let arrives = through(column(p, drawn.d / scene.h, FAR, FAR));
    return spectrum(map_radiance(map, drawn.d)) * arrives * phase / (phase + drawn.pdf);
}

// What a path meets that leaves the volume along d, drawn with the density `chance` per steradian.
fn met(d: vec3<f32>, chance: f32) -> Spectrum {
    var sum = job.background;
    for (var i = 0u; i < MAPS; i++) {
        sum += chance / max(chance + map_pdf(i, d), 1e-30) * map_radiance(i, d);
    }
    return spectrum(sum);
}
