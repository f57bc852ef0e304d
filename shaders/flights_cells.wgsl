// Flights below a grid of majorants.

// Extinction coefficients that are nowhere exceeded, x fastest.
@group(0) @binding(4) var<storage, read> majorants: array<f32>;

// Cells that are crossed before a flight pauses.
override CELLS: u32 = 64u;

// Flies through cells to the next tentative collision, or out; after CELLS of them it pauses.
fn advance(f: ptr<function, Flight>) -> u32 {
    let block = f32(scene.block);
    let v = (*f).d * scene.inverse_h;
    var p = (*f).p;
    var at = (*f).at;
    if at.x < 0 {
        at = min(vec3<i32>(max(p, vec3(0.0)) * (1.0 / block)), scene.cells - 1);
    }
    let upward = vec3<i32>(v > vec3(0.0));
    var depth = (*f).depth;
    var majorant = 1.0;
    var state = FLYING;
    for (var k = 0u; k < CELLS && state == FLYING; k++) {
        majorant = majorants[u32((at.z * scene.cells.y + at.y) * scene.cells.x + at.x)];
        let edge = min(vec3<f32>(at + upward) * block, vec3<f32>(scene.n));
        let way = select(max((edge - p) / v, vec3(0.0)), vec3(FAR), v == vec3(0.0));
        let exit = min(way.x, min(way.y, way.z));
        let free = select(FAR, depth / majorant, majorant > 0.0);
        let stops = free < exit;
        let t = select(exit, free, stops);
        depth = max(depth - t * majorant, 0.0);
        // Rounding must not carry a tentative collision out of the cell whose majorant it has.
        let low = vec3<f32>(at) * block;
        let high = min(low + block, vec3<f32>(scene.n)) * (1.0 - 6e-8);
        p = max(min(p + v * t, high), low);
        if stops {
            state = TENTATIVE;
        } else {
            // The axis of the face that is crossed.
            let a = select(select(2, 1, way.y == exit), 0, way.x == exit);
            p[a] = edge[a];
            let next = at[a] + 2 * upward[a] - 1;
            if next < 0 || next >= scene.cells[a] {
                state = LEFT;
            } else {
                at[a] = next;
            }
        }
    }
    (*f).p = p;
    (*f).q = p;
    (*f).at = at;
    (*f).depth = depth;
    (*f).free_path = 1.0 / majorant;
    return state;
}
