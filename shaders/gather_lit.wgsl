// Order 1 of a light within a step of a view ray: in parts short enough that the depth towards the light changes little in
// each. Under a low sun that depth grows many times as fast along a view ray as the depth towards the eye does.

// Change of the depth towards the light between the two Gauss points of a part: beyond, it is halved. Their rule is then
// right to .2 %.
const LIT_DEPTH = 1.0;
// What lies behind this depth is dark.
const DARK = 20.0;
// The shortest part of a step.
const PARTS = 64u;

// Adds a light's order 1 of a part of a step, or halves the part; whether that was the last one.
fn lit(s: ptr<function, Sums>, light: Light, ray: Ray, start: f32, profile: Profile) -> bool {
    // The first part is the whole step.
    let width = select((*s).width, PARTS, (*s).width == 0u);
    let low = f32((*s).at) / f32(PARTS);
    let part = f32(width) / f32(PARTS);
    let places = low + vec2(U1, U2) * part;
    let p1 = along(ray.p, ray.v, start + places.x * profile.step);
    let p2 = along(ray.p, ray.v, start + places.y * profile.step);
    let here1 = incident(light, p1);
    let here2 = incident(light, p2);
    let columns = vec2(light_column(light, p1, here1), light_column(light, p2, here2));
    if width > 1u && is_steep(columns) {
        // Of the whole step only where the depth grows steadily.
        if width < PARTS || is_even(light, columns, along(ray.p, ray.v, start + 0.5 * profile.step)) {
            (*s).width = width / 2u;
            return false;
        }
    }
    let weights = vec2(profile_density(profile, places.x), profile_density(profile, places.y)) * (0.5 * part * profile.step);
    let f1 = factor(p1, weights.x, (*s).column + profile_column(profile, places.x));
    let f2 = factor(p2, weights.y, (*s).column + profile_column(profile, places.y));
    (*s).order1 += rgb(f1 * arriving(light, here1, columns.x, ray.direction));
    (*s).order1 += rgb(f2 * arriving(light, here2, columns.y, ray.direction));
    (*s).at += width;
    // A part begins at a multiple of its width, and may be twice as wide as the one before.
    (*s).width = select(width, 2u * width, (*s).at % (2u * width) == 0u && width < PARTS / 2u);
    if (*s).at < PARTS {
        return false;
    }
    (*s).at = 0u;
    (*s).width = 0u;
    return true;
}

// Whether the depth towards a light changes too much between two Gauss points, unless all around them is dark.
fn is_steep(columns: vec2<f32>) -> bool {
    let change = abs(columns.y - columns.x);
    // On the line through both, the column at the brighter end: .366 of their distance beyond.
    let least = min(columns.x, columns.y) - 0.366 * change;
    let least_extinction = min(min(scene.extinction.x, scene.extinction.y), scene.extinction.z);
    return change * scene.top_extinction > LIT_DEPTH && least * least_extinction < DARK;
}

// Whether the column density in the middle between two points is about halfway between theirs: the depth grows steadily,
// and parts of the step resolve it. At the edge of a shadow it jumps, and they would not.
fn is_even(light: Light, columns: vec2<f32>, middle: vec3<f32>) -> bool {
    let column = light_column(light, middle, incident(light, middle));
    return abs(column - 0.5 * (columns.x + columns.y)) < 0.1 * abs(columns.y - columns.x);
}

// What a light sends through a node towards the eye, per factor.
fn arriving(light: Light, here: Incident, column: f32, view: vec3<f32>) -> Spectrum {
    let scattered = here.falloff * toward_eye(here.direction, view);
    return spectrum(light.value) * scattered * expos(-spectrum(scene.extinction) * column);
}
