//! Masses of cells in rows, from which cells are drawn.

use rayon::prelude::*;

/// Masses of cells in rows, from which cells are drawn.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Table {
    /// Sums of the rows' masses up to the end of each.
    rows: Vec<f64>,
    /// Sums within each row up to the end of each cell.
    cells: Vec<f64>,
    width: usize,
}

impl Table {
    /// The whole of integer parts.
    pub const UNIT: u32 = 1 << 31;

    pub fn new(width: usize, height: usize, mass: impl Fn(usize, usize) -> f64 + Sync) -> Self {
        let mut cells = vec![0.0; width * height];
        cells.par_chunks_mut(width).enumerate().for_each(|(row, line)| {
            let mut sum = 0.0;
            for (column, cell) in line.iter_mut().enumerate() {
                sum += mass(row, column);
                *cell = sum;
            }
        });
        let mut total = 0.0;
        let rows = cells
            .chunks(width)
            .map(|line| {
                total += line.last().copied().unwrap_or(0.0);
                total
            })
            .collect();
        Table { rows, cells, width }
    }

    pub fn total(&self) -> f64 {
        self.rows.last().copied().unwrap_or(0.0)
    }

    /// Sums of the rows' masses up to the end of each.
    pub fn rows(&self) -> &[f64] {
        &self.rows
    }

    /// The row at the part `u` of all mass, and the rest of `u` within it.
    pub fn row(&self, u: f64) -> (usize, f64) {
        pick(&self.rows, u)
    }

    /// The cell at the part `v` of a row's mass, and the rest of `v` within it.
    pub fn column(&self, row: usize, v: f64) -> (usize, f64) {
        pick(&self.cells[row * self.width..(row + 1) * self.width], v)
    }

    /// The ends of the rows, and of the cells within each, in parts of [`Table::UNIT`]. A chance that is a difference
    /// of them is what it is exactly, to 2^-31 the one by mass, and not 0 where there is mass. All is in the first cell
    /// where there is none.
    pub fn ends(&self) -> [Vec<u32>; 2] {
        let mut rows = vec![0; self.rows.len()];
        whole(&self.rows, &mut rows);
        let mut cells = vec![0; self.cells.len()];
        let lines = cells.par_chunks_mut(self.width).zip(self.cells.par_chunks(self.width));
        lines.for_each(|(ends, sums)| whole(sums, ends));
        [rows, cells]
    }

    pub fn mass(&self, row: usize, column: usize) -> f64 {
        let at = row * self.width + column;
        self.cells[at] - if column > 0 { self.cells[at - 1] } else { 0.0 }
    }
}

/// The ends of the parts of a running sum in integers, the last at [`Table::UNIT`]: each part that adds something is
/// one at least.
fn whole(sums: &[f64], ends: &mut [u32]) {
    let total = sums.last().copied().unwrap_or(0.0);
    if total == 0.0 {
        ends.fill(Table::UNIT);
        return;
    }
    let adds = |at: usize| u32::from(sums[at] > if at > 0 { sums[at - 1] } else { 0.0 });
    let mut rest: u32 = (0..sums.len()).map(adds).sum();
    let mut before = 0;
    for (at, end) in ends.iter_mut().enumerate() {
        rest -= adds(at);
        let near = (sums[at] / total * f64::from(Table::UNIT)).round() as u32;
        *end = near.max(before + adds(at)).min(Table::UNIT - rest);
        before = *end;
    }
}

/// The place at the part `u` of a running sum, one that adds something, and the rest of `u` within it.
fn pick(sums: &[f64], u: f64) -> (usize, f64) {
    let target = u * sums.last().copied().unwrap_or(0.0);
    let mut i = sums.partition_point(|&sum| sum <= target).min(sums.len().saturating_sub(1));
    while i > 0 && sums[i] == sums[i - 1] {
        i -= 1;
    }
    let low = if i > 0 { sums[i - 1] } else { 0.0 };
    let width = sums[i] - low;
    (i, if width > 0.0 { ((target - low) / width).clamp(0.0, 1.0) } else { 0.5 })
}
