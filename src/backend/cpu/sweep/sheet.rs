//! Densities between two planes of voxels, resampled for rows of rays.

use super::{Reading, Sweep};

/// The density of one reading, row by row of rays: rows of voxels are resampled once and kept while they are needed.
pub struct Sheet {
    blend: Vec<f32>,
    kept: [(usize, Vec<f32>); 2],
    out: Vec<f32>,
}

const NONE: usize = usize::MAX;

impl Sheet {
    /// Rows of so many rays.
    pub fn new(sweep: &Sweep, count: usize) -> Self {
        let row = || (NONE, vec![0.0; count]);
        Sheet { blend: vec![0.0; sweep.lattice[0].n + 1], kept: [row(), row()], out: vec![0.0; count] }
    }

    /// For the next reading.
    pub fn clear(&mut self) {
        self.kept.iter_mut().for_each(|row| row.0 = NONE);
    }

    /// The density along row `j` of rays.
    pub fn row(&mut self, sweep: &Sweep, reading: &Reading, j: usize, (i0, i1): (usize, usize)) -> &[f32] {
        let (v, upper) = (reading.v.0[j] as usize, reading.v.1[j]);
        let next = (v + 1).min(sweep.lattice[1].n - 1);
        // Rows come in order: what was the upper may now be the lower.
        if self.kept[0].0 != v {
            self.kept.swap(0, 1);
        }
        for (at, wanted) in [(0, v), (1, next)] {
            if self.kept[at].0 != wanted {
                self.read(sweep, reading, at, wanted, (i0, i1));
            }
        }
        let (low, high) = (&self.kept[0].1, &self.kept[1].1);
        for i in i0..i1 {
            self.out[i] = low[i] + upper * (high[i] - low[i]);
        }
        &self.out
    }

    /// Resamples row `v` of voxels.
    fn read(&mut self, sweep: &Sweep, reading: &Reading, at: usize, v: usize, (i0, i1): (usize, usize)) {
        let n = sweep.lattice[0].n;
        sweep.blend(v, reading, &mut self.blend[..n]);
        self.blend[n] = self.blend[n - 1];
        let (cells, upper) = &reading.u;
        let (key, row) = &mut self.kept[at];
        *key = v;
        for i in i0..i1 {
            let cell = cells[i] as usize;
            let (low, high) = (self.blend[cell], self.blend[cell + 1]);
            row[i] = low + upper[i] * (high - low);
        }
    }
}

impl Sweep<'_> {
    /// Row `v` of voxels, between the two planes of a reading.
    fn blend(&self, v: usize, reading: &Reading, out: &mut [f32]) {
        let [a, b] = reading.planes.map(|k| if self.sector.forward { k } else { self.depth - 1 - k } as i32);
        let voxel = |k: i32| match self.sector.axis {
            0 => [k, 0, v as i32],
            1 => [0, k, v as i32],
            _ => [0, v as i32, k],
        };
        let stride = if self.sector.axis == 0 { self.field.n()[0] as usize } else { 1 };
        let (a, b) = (self.field.from(voxel(a)), self.field.from(voxel(b)));
        let upper = reading.upper;
        if stride == 1 {
            for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
                *out = a + upper * (b - a);
            }
        } else {
            for ((out, a), b) in out.iter_mut().zip(a.iter().step_by(stride)).zip(b.iter().step_by(stride)) {
                *out = a + upper * (b - a);
            }
        }
    }
}
