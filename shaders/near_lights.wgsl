// Lights in the medium or next to it: points on the way to the next vertex are drawn by their distance from the light, in
// place of the vertices themselves. They follow the far ones in `lights`.

override NEAR_LIGHTS: u32 = 0u;

// The purposes of their random numbers begin here.
const NEAR = 65536u;
// The directions of a joint connection: half by the phase function, half by 1 / sine of the angle to the light.
const TOWARDS_LIGHT = 0.5;

// Points on a line by the angle under which a light sees them (Kulla and Fajardo, Importance sampling techniques for path
// tracing in participating media, EGSR 2012).
struct Equiangular {
    // The point nearest to the light, its distance from the light, and the line's length; nothing if that is 0.
    foot: f32,
    off: f32,
    length: f32,
    // The angles of both ends.
    ends: vec2<f32>,
}

// For a line of the given length.
fn equiangular(foot: f32, off: f32, length: f32) -> Equiangular {
    let away = max(off, 1e-6 * max(length, abs(foot)));
    let ends = vec2(angle(-foot, away), angle(length - foot, away));
    return Equiangular(foot, away, select(0.0, length, ends.y > ends.x && away > 0.0), ends);
}

// A point.
fn equiangular_at(line: Equiangular, xi: f32) -> f32 {
    let turned = line.ends.x + (line.ends.y - line.ends.x) * xi;
    return min(max(line.foot + line.off * tangent(turned), 0.0), line.length);
}

// 1 / (density of t * squared distance from the light).
fn equiangular_spread(line: Equiangular) -> f32 {
    return (line.ends.y - line.ends.x) / line.off;
}

// The line from p along the unit vector d as a light sees it.
fn equiangular_on(light: Light, p: vec3<f32>, d: vec3<f32>, length: f32) -> Equiangular {
    let to = (light.place - p) * scene.h;
    let foot = to.x * d.x + to.y * d.y + to.z * d.z;
    return equiangular(foot, norm(to - foot * d), length);
}

fn norm(v: vec3<f32>) -> f32 {
    return sqrt(v.x * v.x + v.y * v.y + v.z * v.z);
}

// The light of a near light at a point y that the path comes to along `travel`, over its transmittance and without
// 1 / distance^2: value * P * transmittance of the way from the light, by channel.
fn arriving(light: Light, y: vec3<f32>, travel: vec3<f32>) -> Spectrum {
    let at = incident(light, y);
    return spectrum(light.value) * phase_towards(at.direction, travel) * through(light_ray(y, at));
}

// The light of a near light that is scattered once more beyond a vertex at p, where the path arrived along `travel` and
// scatters: over the albedo there. Drawn jointly in direction and distance, so that 1 / distance^2 from the light is no
// part of its weight.
fn once_more(light: Light, p: vec3<f32>, travel: vec3<f32>, word: vec4<u32>) -> Spectrum {
    let to = (light.place - p) * scene.h;
    let way = max(norm(to), 1e-20);
    var d: vec3<f32>;
    if (word.w & 1u) == 0u {
        let polar = sin_cos_turn(0.5 * unit(word.x));
        d = rotate(to / way, polar.y, polar.x, unit(word.y));
    } else {
        let polar = phase_sample(unit(word.x));
        d = rotate(travel, polar.x, polar.y, unit(word.y));
    }
    let foot = to.x * d.x + to.y * d.y + to.z * d.z;
    let off = norm(to - foot * d);
    let phase = phase_pdf(min(max(d.x * travel.x + d.y * travel.y + d.z * travel.z, -1.0), 1.0));
    let sin_light = max(off / way, 1e-6);
    let chance = TOWARDS_LIGHT * (0.5 * FRAC_1_PI * FRAC_1_PI) / sin_light + (1.0 - TOWARDS_LIGHT) * phase;
    let v = d / scene.h;
    let line = equiangular(foot, off, leave(p, v).t);
    if line.length <= 0.0 {
        return Spectrum(0.0);
    }
    let t = equiangular_at(line, unit(word.z));
    let y = along(p, v, t);
    let density = density_at(y);
    if density <= 0.0 {
        return Spectrum(0.0);
    }
    let between = through(column(p, v, t, FAR));
    // The light's 1 / distance^2 cancels against that in the density of t.
    let scale = phase / chance * equiangular_spread(line) * density;
    let further = albedo_read(y, word.w >> 1u);
    return scale * between * arriving(light, y, d) * further * spectrum(scene.extinction);
}

// What near lights add at a vertex.
fn connect_near(path: ptr<function, Path>, f: ptr<function, Flight>) {
    for (var i = 0u; i < NEAR_LIGHTS; i++) {
        let word = connection_words(f, NEAR + i);
        let light = once_more(lights[FAR_LIGHTS + i], (*f).p, (*f).d, word);
        see(path, (*path).order + 1u, unbiased((*path).weights) * light);
    }
}

// What near lights send to the eye by being scattered once on a view ray: at a first collision, and at a point drawn for
// each light by its distance from it, by the balance heuristic of both.
fn near_view(path: ptr<function, Path>, start: Start) {
    let v = (*path).direction * scene.inverse_h;
    for (var i = 0u; i < 2u * NEAR_LIGHTS; i++) {
        let light = lights[FAR_LIGHTS + i / 2u];
        let line = equiangular_on(light, (*path).entry, (*path).direction, (*path).length);
        if line.length > 0.0 {
            var p = start.p;
            var t = start.t;
            var so_far = start.column;
            if i % 2u == 1u {
                t = equiangular_at(line, start.xi);
                p = along((*path).entry, v, t);
                so_far = column((*path).entry, v, t, FAR);
            }
            let density = density_at(p);
            if density > 0.0 {
                let from_foot = t - line.foot;
                let distance2 = line.off * line.off + from_foot * from_foot;
                let collision = first_density(path, so_far) * density;
                // Both chances times the squared distance: near the light the first is constant and the second vanishes.
                let scale = density / (1.0 / equiangular_spread(line) + collision * distance2);
                let light = spectrum(scene.extinction) * through(so_far) * arriving(light, p, (*path).direction);
                see(path, 1u, albedo_read(p, start.word) * scale * light / (*path).top);
            }
        }
    }
}
