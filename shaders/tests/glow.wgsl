// What a medium emits along lines, in one go and cut, and the integral and the value of its source term.

struct Line {
    p: vec3<f32>,
    length: f32,
    v: vec3<f32>,
    // How many cells at a time.
    cells: u32,
}

@group(0) @binding(24) var<storage, read> lines: array<Line>;
@group(0) @binding(25) var<storage, read_write> found: array<array<f32, 12>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&lines) {
        return;
    }
    let line = lines[id.x];
    let whole = rgb(glow_along(line.p, line.v, line.length));
    var glow = glow_start(line.p, line.v);
    while glow.over == 0u {
        glow_from(line.p, line.v, line.length, &glow, line.cells);
    }
    let cut = rgb(glow.sum);
    found[id.x] = array(
        whole.x, whole.y, whole.z, cut.x, cut.y, cut.z,
        emission_column(0u, line.p, line.v, line.length), emission_column(1u, line.p, line.v, line.length),
        emission_column(2u, line.p, line.v, line.length),
        emission_at(0u, line.p), emission_at(1u, line.p), emission_at(2u, line.p),
    );
}
