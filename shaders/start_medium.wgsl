// A medium that emits by itself, whose voxels are drawn by what they emit in all channels together, each over its
// mean.

// Whether the source term is linear between voxel centres.
override HATS: bool = false;
// Whether all channels emit the same.
override GREY: bool = true;

fn start(j: u32, f: ptr<function, Flight>) -> Start {
    let u = stratum(j, start_words(f).x);
    let word = start_words(f);
    let more = start_words(f);
    let at = pick_cell(u);
    let voxel = vec3<f32>(vec3(at.cell, at.row % emitter.height, at.row / emitter.height));
    let xi = vec3(unit(word.z), unit(word.w), unit(more.x));
    var p = voxel + xi;
    if HATS {
        // A hat of interpolation is the sum of two uniform numbers, folded back at the box's faces, where values are clamped.
        let n = vec3<f32>(scene.n);
        p = abs(p + vec3(unit(more.y), unit(more.z), unit(more.w)) - 0.5);
        p = select(p, 2.0 * n - p, p > n);
    }
    p = clamp(p, vec3(0.0), vec3<f32>(scene.n));
    (*f).p = p;
    (*f).d = sphere(unit(word.x), unit(word.y));
    if GREY {
        return Start(FLIES, spectrum(emitter.colour));
    }
    let values = vec3(emission_at(0u, p), emission_at(1u, p), emission_at(2u, p));
    let parts = values * emitter.factors;
    let sum = max(parts.x + parts.y + parts.z, 1e-38);
    return Start(FLIES, spectrum(parts / sum * emitter.colour));
}
