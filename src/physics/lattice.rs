//! Rank-1 lattices of the unit square: points that are even in every projection.

/// A lattice that repeats in each unit square, with a Fibonacci number of points in it: point i is at (i, i s) / points modulo
/// 1, s the Fibonacci number before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lattice {
    points: u64,
    step: u64,
}

impl Lattice {
    /// The smallest lattice of at least so many points.
    pub fn of(points: f64) -> Self {
        let (mut step, mut all) = (1u64, 1u64);
        while (all as f64) < points.min(1e12) {
            (step, all) = (all, step + all);
        }
        Lattice { points: all, step }
    }

    /// The largest lattice of at most so many points, 1 at least.
    pub fn up_to(points: f64) -> Self {
        let found = Lattice::of(points);
        if found.points as f64 > points && found.points > 1 {
            Lattice { points: found.step, step: found.points - found.step }
        } else {
            found
        }
    }

    /// Its points per unit square.
    pub fn points(&self) -> u64 {
        self.points
    }

    /// Its points, shifted.
    #[inline(always)]
    pub fn each(&self, shift: [f64; 2], mut f: impl FnMut(f64, f64)) {
        let scale = 1.0 / self.points as f64;
        let mut second = 0;
        for i in 0..self.points {
            let x = i as f64 * scale + shift[0];
            let y = second as f64 * scale + shift[1];
            f(if x < 1.0 { x } else { x - 1.0 }, if y < 1.0 { y } else { y - 1.0 });
            second += self.step;
            second -= if second >= self.points { self.points } else { 0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lattices_have_fibonacci_numbers_of_points() {
        assert_eq!([0.0, 1.0, 1.5, 8.0, 9.0].map(|n| Lattice::of(n).points()), [1, 1, 2, 8, 13]);
        assert_eq!([0.0, 1.0, 1.5, 8.0, 12.9].map(|n| Lattice::up_to(n).points()), [1, 1, 1, 8, 8]);
    }

    #[test]
    fn a_shifted_lattice_is_even_along_each_axis_and_integrates_waves() {
        for points in [1.0, 2.0, 3.0, 34.0, 144.0] {
            let lattice = Lattice::of(points);
            let n = lattice.points() as f64;
            let (mut x, mut y, mut wave) = (Vec::new(), Vec::new(), 0.0);
            lattice.each([0.37, 0.81], |a, b| {
                assert!((0.0..1.0).contains(&a) && (0.0..1.0).contains(&b));
                x.push(a);
                y.push(b);
                wave += (std::f64::consts::TAU * (2.0 * a + b)).cos() / n;
            });
            for mut list in [x, y] {
                list.sort_by(f64::total_cmp);
                assert!(list.windows(2).all(|w| (w[1] - w[0] - 1.0 / n).abs() < 1e-12));
            }
            assert!(n < 5.0 || wave.abs() < 1e-12, "{n}: {wave}");
        }
    }
}
