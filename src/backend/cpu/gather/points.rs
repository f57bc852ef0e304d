//! Where the rays of a pixel pass.

/// Points of a pixel, `n` by `n`: one in each of its equal squares, and one in each of its `n^2` columns and rows. The
/// squares' columns are taken in the order of the multiples of [`stride`] modulo n + 1, the rows in the reverse, so that the
/// points stay the same under quarter turns, and a plane's mean over them is exact (after Kensler, *Correlated
/// multi-jittered sampling*, 2013).
#[inline(always)]
pub fn point(n: usize, stride: usize, at: usize) -> (f64, f64) {
    let (i, j) = (at % n, at / n);
    let order = |k: usize| ((k + 1) * stride % (n + 1)) as f64;
    let parts = n as f64;
    ((i as f64 + (order(j) - 0.5) / parts) / parts, (j as f64 + (parts + 0.5 - order(i)) / parts) / parts)
}

/// The number nearest below the golden section of n + 1 that has no factor in common with it.
pub fn stride(n: usize) -> usize {
    let common = |mut a: usize, mut b: usize| {
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    (1..=(n + 1) * 618 / 1000).rev().find(|&k| common(k, n + 1) == 1).unwrap_or(1)
}
