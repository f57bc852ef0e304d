// Equirectangular maps of the radiance that comes from the sky. A direction d points to the sky. With z up, rows go
// down from +z: theta = pi y / height; columns go to the right of a viewer: x / width = 1/2 + atan2(d.x, d.y) / (2 pi).
// A map is bilinear between texel centres, wrapped in azimuth and clamped at the poles.

struct Map {
    width: u32,
    height: u32,
    // 1 or 3.
    channels: u32,
    // Where it begins in map_values.
    values: u32,
    // Where it begins in map_sums.
    sums: u32,
    spare: u32,
}

@group(0) @binding(32) var<storage, read> maps: array<Map>;
// Of each map its texels; 1 - cos(theta) at the upper edge of each row and at the lower edge of the last; and 2^-62
// over the solid angle of each row's texels, 0 for a dark map.
@group(0) @binding(33) var<storage, read> map_values: array<f32>;
// Of each map the ends of its rows as parts of all importance, and the ends of its texels as parts of their row's, in
// 2^-31.
@group(0) @binding(34) var<storage, read> map_sums: array<u32>;

struct MapSample {
    // Unit vector to the sky.
    d: vec3<f32>,
    // Its density [1/sr].
    pdf: f32,
}

// The radiance of a map from the direction d.
fn map_radiance(map: u32, d: vec3<f32>) -> vec3<f32> {
    return map_at(map, map_place(map, d));
}

// A direction and its density, from two uniform numbers: a texel by its mean radiance (of the brightest channel) times
// its solid angle, and a direction uniform over it.
fn map_sample(map: u32, u: f32, v: f32) -> MapSample {
    let m = maps[map];
    let row = map_pick(m.sums, m.height, u);
    let column = map_pick(m.sums + m.height + row.at * m.width, m.width, v);
    let d = map_direction(map, vec2(column.at, row.at), vec2(column.rest, row.rest));
    return MapSample(d, map_density(map, row, column));
}

// The density per steradian with which map_sample draws the direction d.
fn map_pdf(map: u32, d: vec3<f32>) -> f32 {
    let m = maps[map];
    let texel = min(vec2<u32>(map_place(map, d)), vec2(m.width, m.height) - 1u);
    let row = map_share(m.sums, texel.y);
    return map_density(map, row, map_share(m.sums + m.height + texel.y * m.width, texel.x));
}

// The texel coordinates of a direction: x within [0, width], y within [0, height].
fn map_place(map: u32, d: vec3<f32>) -> vec2<f32> {
    let turn = angle(d.x, d.y) * (0.5 * FRAC_1_PI) + 0.5;
    let polar = angle(sqrt(d.x * d.x + d.y * d.y), d.z) * FRAC_1_PI;
    return vec2(turn * f32(maps[map].width), polar * f32(maps[map].height));
}

// The bilinear value at texel coordinates.
fn map_at(map: u32, place: vec2<f32>) -> vec3<f32> {
    let m = maps[map];
    let p = vec2(place.x - 0.5, min(max(place.y - 0.5, 0.0), f32(m.height - 1u)));
    let low = floor(p);
    let part = p - low;
    // From -1 to width: wrapped.
    let left = (u32(i32(low.x) + i32(m.width))) % m.width;
    let right = select(0u, left + 1u, left + 1u < m.width);
    let top = u32(low.y);
    let bottom = min(top + 1u, m.height - 1u);
    let high = map_line(m, top, left, right, part.x);
    return high + part.y * (map_line(m, bottom, left, right, part.x) - high);
}

// The value in a row between two columns.
fn map_line(m: Map, row: u32, left: u32, right: u32, part: f32) -> vec3<f32> {
    let start = map_texel(m, row, left);
    return start + part * (map_texel(m, row, right) - start);
}

// The radiance of a texel.
fn map_texel(m: Map, row: u32, column: u32) -> vec3<f32> {
    let at = m.values + (row * m.width + column) * m.channels;
    if m.channels == 1u {
        return vec3(map_values[at]);
    }
    return vec3(map_values[at], map_values[at + 1u], map_values[at + 2u]);
}

// Unit vector to the place, each coordinate within [0, 1], of a texel (column, row), uniform over it if they are.
fn map_direction(map: u32, texel: vec2<u32>, place: vec2<f32>) -> vec3<f32> {
    let m = maps[map];
    let edges = m.values + m.width * m.height * m.channels;
    // 1 - |cos theta| from the nearer pole, which keeps its precision there.
    let upper = f32(texel.y) + place.y < 0.5 * f32(m.height);
    let edge = edges + select(m.height - 1u - texel.y, texel.y, upper);
    let y = select(1.0 - place.y, place.y, upper);
    let near = map_values[edge] + y * (map_values[edge + 1u] - map_values[edge]);
    let sine = sqrt(near * (2.0 - near));
    let turn = sin_cos_turn((f32(texel.x) + place.x) / f32(m.width) - 0.5);
    return vec3(sine * turn.x, sine * turn.y, select(near - 1.0, 1.0 - near, upper));
}

// A place in a running sum of importance.
struct MapPick {
    at: u32,
    // The importance there [2^-31].
    share: f32,
    // The rest of the uniform number within it.
    rest: f32,
}

// The place at the part u of the sum that begins at `first` in map_sums, one that adds something.
fn map_pick(first: u32, count: u32, u: f32) -> MapPick {
    let scaled = u * 2147483648.0;
    let whole = min(u32(scaled), 0x7fffffffu);
    // How many end at or before it.
    var at = 0u;
    for (var step = 1u << (31u - countLeadingZeros(count)); step > 0u; step /= 2u) {
        if at + step < count && map_sums[first + at + step - 1u] <= whole {
            at += step;
        }
    }
    let start = map_start(first, at);
    let share = f32(map_sums[first + at] - start);
    return MapPick(at, share, (f32(whole - start) + (scaled - f32(whole))) / share);
}

// The importance at a place of the sum that begins at `first`.
fn map_share(first: u32, at: u32) -> MapPick {
    return MapPick(at, f32(map_sums[first + at] - map_start(first, at)), 0.0);
}

// Where a place begins.
fn map_start(first: u32, at: u32) -> u32 {
    if at == 0u {
        return 0u;
    }
    return map_sums[first + at - 1u];
}

// Density per steradian of a texel's directions.
fn map_density(map: u32, row: MapPick, column: MapPick) -> f32 {
    let m = maps[map];
    let densities = m.values + m.width * m.height * m.channels + m.height + 1u;
    return row.share * column.share * map_values[densities + row.at];
}
