// The light of a sky map that falls on the box: directions by radiance (summed over channels, each over its mean) times projected area, drawn from
// bounds of that for each texel.

// Directions that are tried before the search pauses.
const TRIES = 32;

fn start(j: u32, f: ptr<function, Flight>) -> Start {
    var u: vec2<u32>;
    if (*f).block == 0u {
        u = stratum(j, start_words(f).x);
        (*f).block += 1u;
    } else {
        u = words(scene.seed, (*f).index, (*f).block - 1u, 0u).wz;
    }
    let m = maps[0];
    let densities = m.values + m.width * m.height * m.channels + m.height + 1u;
    for (var i = 0; i < TRIES; i++) {
        let word = start_words(f);
        let at = pick_cell(u);
        let sky = map_direction(0u, vec2(at.cell, at.row), vec2(unit(word.x), at.rest));
        let radiance = map_radiance(0u, sky);
        let parts = radiance * emitter.factors;
        let sum = parts.x + parts.y + parts.z;
        let area = dot(abs(sky), emitter.faces);
        let bound = at.chance * emitter.distance * (map_values[densities + at.row] * 4611686018427387904.0);
        if sum * area > unit(word.y) * bound {
            let place = words(scene.seed, (*f).index, 1u, 0u);
            let d = -sky;
            let face = pick_area(unit(place.x) * area, abs(d) * emitter.faces);
            (*f).p = on_face(face.axis, select(1.0, 0.0, d[face.axis] > 0.0), face.rest, unit(place.y));
            (*f).d = d;
            if m.channels == 1u {
                return Start(FLIES, spectrum(emitter.colour));
            }
            return Start(FLIES, spectrum(parts / sum * emitter.colour));
        }
        u = word.wz;
    }
    return Start(SEARCHES, spectrum(vec3(0.0)));
}

// The axis of a face chosen by area, and the rest of u within it.
fn pick_area(u: f32, areas: vec3<f32>) -> Face {
    if u < areas.x {
        return Face(0, u / areas.x);
    }
    if u < areas.x + areas.y {
        return Face(1, (u - areas.x) / areas.y);
    }
    return Face(2, min((u - areas.x - areas.y) / max(areas.z, 1e-30), 1.0));
}
