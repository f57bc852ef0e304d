// Photons at their first collisions, drawn from the light grid.

// Whether a start draws its place from a block of random words of its own.
override APART: bool = false;
// Whether depths are interpolated.
override INTERPOLATED: bool = false;

fn start(j: u32, f: ptr<function, Flight>) -> Start {
    var word = start_words(f);
    let at = pick_cell(stratum(j, word.x));
    var place = word.yzw;
    if APART {
        place = start_words(f).xyz;
    } else {
        (*f).word = start_words(f);
        (*f).xi = unit((*f).word.z);
    }
    let voxel = vec3(at.cell, at.row % emitter.height, at.row / emitter.height);
    let p = vec3<f32>(voxel) + vec3(unit(place.x), unit(place.y), unit(place.z));
    let light = lights[0];
    let arriving = incident(light, p);
    var depth = 0.0;
    if INTERPOLATED {
        depth = rough_column(light, p, arriving);
    } else {
        depth = light_column(light, p, arriving);
    }
    (*f).p = p;
    (*f).d = arriving.direction;
    let scale = density_at(p) * arriving.falloff * emitter.scale / at.chance;
    let extinction = spectrum(scene.extinction);
    let weight = extinction * spectrum(emitter.colour) * expos(-extinction * depth) * scale;
    return Start(COLLIDES, weight);
}
