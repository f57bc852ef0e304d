// View rays, and the first collisions on them: drawn evenly over what a ray meets.

// The purpose of the random numbers of view rays.
const VIEW = 8u;
const TAU = 6.2831853;

// Where near lights are seen.
@group(0) @binding(26) var<storage, read> images: array<Image>;

// The start of a path, at its first collision.
struct Start {
    // Where on the ray.
    p: vec3<f32>,
    t: f32,
    // Column density up to it.
    column: f32,
    // The channel that decided on it.
    hero: u32,
    // A uniform number for a second point of the ray.
    xi: f32,
    // A random word.
    word: u32,
}

// The pixel of a view ray of the job.
fn pixel_of(ray: u32) -> vec2<u32> {
    let at = job.pixel + ray / job.count;
    return job.first + vec2(at % job.columns, at / job.columns);
}

// The number of a view ray of the job among all view rays of all runs of the seed.
fn number_of(ray: u32) -> vec2<u32> {
    let pixel = pixel_of(ray);
    let ahead = times64(ray % job.count, mul_wide(job.resolution.x, job.resolution.y));
    return add64(add64(job.number, ahead), add64(mul_wide(pixel.y, job.resolution.x), vec2(pixel.x, 0u)));
}

// Takes up the slot's view ray.
fn look(path: ptr<function, Path>) {
    let pixel = pixel_of((*path).ray);
    let place = place_in_pixel(vec2<i32>(pixel), words(scene.seed, number_of((*path).ray), 0u, VIEW));
    (*path).one = Spectrum(0.0);
    (*path).more = Spectrum(0.0);
    (*path).share = 0.0;
    (*path).state = NEXT;
    // A ray that meets nothing has no paths.
    (*path).begun = STARTS;
    let ray = view_ray(view_place(pixel.y * job.resolution.x + pixel.x, place.xy));
    if ray.length <= 0.0 || place.z == 0.0 {
        return;
    }
    (*path).entry = ray.p;
    (*path).length = ray.length;
    (*path).direction = ray.direction;
    (*path).opacity = vec3(1.0);
    if WALKED {
        let column = column(ray.p, ray.v, ray.length, scene.enough);
        (*path).opacity = -vec3(
            expo_m1(-scene.extinction.x * column),
            expo_m1(-scene.extinction.y * column),
            expo_m1(-scene.extinction.z * column),
        );
        if column <= 0.0 {
            return;
        }
    }
    let top = max(max(max((*path).opacity.x, 0.0), (*path).opacity.y), (*path).opacity.z);
    if top <= 0.0 {
        return;
    }
    (*path).top = top;
    (*path).share = place.z * top / f32(STARTS);
    (*path).begun = 0u;
}

// Takes up the next path of the slot's view ray.
fn begin(path: ptr<function, Path>, f: ptr<function, Flight>) {
    let k = (*path).begun;
    (*path).begun += 1u;
    (*path).order = 0u;
    let number = number_of((*path).ray);
    (*f).index = add64(times64(STARTS, number), vec2(k, 0u));
    (*f).d = (*path).direction;
    if WALKED {
        let start = start_of(path, k, words(scene.seed, number, 1u + k, VIEW));
        near_view(path, start);
        begin_at(f, start.p);
        (*path).weights = first_weights(path, start.hero, start.column);
        (*path).state = HITS;
    } else {
        (*f).p = (*path).entry;
        (*f).block = 0u;
        (*path).weights = outside_weights(f);
        (*path).state = FLIGHT;
    }
}

// The start of path `k`, at the columns' k-th stratum.
fn start_of(path: ptr<function, Path>, k: u32, word: vec4<u32>) -> Start {
    var start: Start;
    start.hero = first_hero(word.y);
    let extinction = scene.extinction[start.hero];
    let opacity = (*path).opacity[start.hero];
    // 1 - part of what is met, from numbers none of which cancel.
    let met = (f32(k) + unit(word.x)) / f32(STARTS) * opacity;
    let missed = (f32(STARTS - 1u - k) + unit(~word.x)) / f32(STARTS) * opacity;
    let left = missed + (1.0 - opacity);
    start.column = -select(ln(left), ln_1p(-met), met < 0.25) / max(extinction, 1e-30);
    let v = (*path).direction * scene.inverse_h;
    start.t = reach((*path).entry, v, (*path).length, start.column);
    start.p = clamp(along((*path).entry, v, start.t), vec3(0.0), vec3<f32>(scene.n) * (1.0 - 6e-8));
    start.xi = (f32(k) + unit(word.z)) / f32(STARTS);
    start.word = word.w;
    return start;
}

// The density of first collisions per column density at a given one, under one channel.
fn first_chance(path: ptr<function, Path>, c: u32, column: f32) -> f32 {
    let extinction = scene.extinction[c];
    let opacity = (*path).opacity[c];
    return select(0.0, extinction * expo(-extinction * column) / opacity, opacity > 0.0);
}

// A point of a pixel, from its upper left corner, and its weight. Evenly drawn, but where a light in the medium is seen in
// the pixel or beside it: there half of the rays are drawn by 1 / distance from its image, as their light is brightest.
fn place_in_pixel(pixel: vec2<i32>, word: vec4<u32>) -> vec3<f32> {
    let even = vec2(unit(word.x), unit(word.y));
    for (var i = 0u; i < job.images; i++) {
        let centre = vec2<f32>(images[i].pixel - pixel) + images[i].place;
        if all(abs(centre - 0.5) < vec2(1.5)) {
            let far = max(abs(centre), abs(1.0 - centre));
            let reach = sqrt(far.x * far.x + far.y * far.y);
            let turn = sin_cos_turn(even.y);
            let drawn = centre + reach * even.x * vec2(turn.y, turn.x);
            let place = select(drawn, even, (word.z & 1u) == 0u);
            if any(place < vec2(0.0)) || any(place > vec2(1.0)) {
                return vec3(even, 0.0);
            }
            let off = max(length(place - centre), 1e-12);
            let chance = 0.5 + 0.5 / (TAU * reach * off);
            return vec3(place, 1.0 / chance);
        }
    }
    return vec3(even, 1.0);
}
