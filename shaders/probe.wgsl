// Runs one function on a table of inputs: the Rust side adds `call(a, b, w)`, which returns four floats or four words.

struct Inputs {
    a: vec4<f32>,
    b: vec4<f32>,
    w: vec4<u32>,
}

@group(0) @binding(24) var<storage, read> inputs: array<Inputs>;
@group(0) @binding(25) var<storage, read_write> outputs: array<vec4<u32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&inputs) {
        let given = inputs[id.x];
        outputs[id.x] = bitcast<vec4<u32>>(call(given.a, given.b, given.w));
    }
}
