// Masses of cells in rows, from which cells are drawn: the ends of the rows as parts of all mass in 2^-64, and the ends of
// the cells as parts of their row's in 2^-32. These parts are the chances, exactly.

@group(0) @binding(11) var<storage, read> row_ends: array<vec2<u32>>;
@group(0) @binding(12) var cell_ends: texture_3d<u32>;

struct Pick {
    row: u32,
    cell: u32,
    // The rest of u within the cell, within [0, 1), and the chance of the cell.
    rest: f32,
    chance: f32,
}

// Where a cell ends: the rows fill layers of emitter.height.
fn cell_end(row: u32, cell: u32) -> u32 {
    return textureLoad(cell_ends, vec3(cell, row % emitter.height, row / emitter.height), 0).x;
}

// The cell at the part u of all mass.
fn pick_cell(u: vec2<u32>) -> Pick {
    // The first row that ends beyond u.
    var low = 0u;
    var high = emitter.rows - 1u;
    while low < high {
        let middle = (low + high) / 2u;
        if less64(u, row_ends[middle]) {
            high = middle;
        } else {
            low = middle + 1u;
        }
    }
    let row = low;
    let before = select(row_ends[max(row, 1u) - 1u], vec2(0u), row == 0u);
    let mass = sub64(row_ends[row], before);
    let x = min(fraction64(sub64(u, before), mass), 0xfffffffeu);
    low = 0u;
    high = emitter.width - 1u;
    while low < high {
        let middle = (low + high) / 2u;
        if x < cell_end(row, middle) {
            high = middle;
        } else {
            low = middle + 1u;
        }
    }
    let start = select(cell_end(row, max(low, 1u) - 1u), 0u, low == 0u);
    let width = f32(cell_end(row, low) - start);
    let chance = float64(mass) * (1.0 / 18446744073709551616.0) * (width * (1.0 / 4294967296.0));
    return Pick(row, low, (f32(x - start) + 0.5) / width, chance);
}
