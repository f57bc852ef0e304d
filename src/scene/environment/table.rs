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

    /// The row at the part `u` of all mass, and the rest of `u` within it.
    pub fn row(&self, u: f64) -> (usize, f64) {
        pick(&self.rows, u)
    }

    /// The cell at the part `v` of a row's mass, and the rest of `v` within it.
    pub fn column(&self, row: usize, v: f64) -> (usize, f64) {
        pick(&self.cells[row * self.width..(row + 1) * self.width], v)
    }

    pub fn mass(&self, row: usize, column: usize) -> f64 {
        let at = row * self.width + column;
        self.cells[at] - if column > 0 { self.cells[at - 1] } else { 0.0 }
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
