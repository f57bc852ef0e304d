// The fate of each photon: collisions and the share of the energy that it ended in.

@group(0) @binding(22) var<storage, read_write> fates: array<vec2<u32>>;

fn end(number: u32, order: u32, share: u32) {
    fates[number] = vec2(order, share);
}
