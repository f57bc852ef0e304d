// Blocks of voxels that hold nothing are passed at once.

// Voxels per block and axis.
override BLOCK: i32;

// Bits of the blocks, x fastest.
@group(0) @binding(29) var<storage, read> occupied: array<u32>;

// Up to where a line is known to meet nothing from t on; t itself where that is nowhere.
fn clear_until(p: vec3<f32>, v: vec3<f32>, t: f32) -> f32 {
    let n = vec3<u32>((scene.n + BLOCK - 1) / BLOCK);
    let block = voxel_of(max(along(p, v, t), vec3(0.0))) / BLOCK;
    let c = vec3<u32>(block);
    let at = (c.z * n.y + c.y) * n.x + c.x;
    if (occupied[at / 32u] >> (at % 32u) & 1u) == 1u {
        return t;
    }
    let edge = vec3<f32>(BLOCK * (block + select(vec3(0), vec3(1), v > vec3(0.0))));
    let leave = select((edge - p) / v, vec3(FAR), v == vec3(0.0));
    return min(min(leave.x, leave.y), leave.z);
}
