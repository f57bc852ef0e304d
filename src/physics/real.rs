//! The number that the physics is generic over: `f64` is the truth, `f32` what the kernels run.
//!
//! The functions of `f32` are polynomials without a branch or a call, so that a loop over photons which uses them becomes
//! vector instructions; and they need IEEE operations only, so that every instruction set gives the same bits. Their
//! coefficients are those of Cephes (Moshier, *Methods and programs for mathematical functions*, 1989: logf, expf, sinf);
//! the tests below state their errors.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A real number. Branches of formulas are written with [`Real::select`], which vectors can follow.
pub trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// A constant.
    fn of(x: f64) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Natural logarithm of a positive normal number.
    fn ln(self) -> Self;
    /// Exponential; 0 below -87.
    fn exp(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// The larger of two.
    fn max(self, other: Self) -> Self;
    /// The smaller of two.
    fn min(self, other: Self) -> Self;
    /// The magnitude of `self` with the sign of `sign`.
    fn copysign(self, sign: Self) -> Self;
    /// Sine and cosine of 2 pi `self`, for |self| < 2^20.
    fn sin_cos_turn(self) -> (Self, Self);
    /// `self < other`.
    fn lt(self, other: Self) -> bool;
    /// `a` where the mask holds, else `b`.
    fn select(mask: bool, a: Self, b: Self) -> Self;
    /// The entry of a table at the index `floor(self)`, which must lie within it.
    fn lookup(self, table: &[f32]) -> Self;
}

macro_rules! real_common {
    ($t:ident) => {
        #[inline(always)]
        fn of(x: f64) -> Self {
            x as $t
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            $t::sqrt(self)
        }
        #[inline(always)]
        fn abs(self) -> Self {
            $t::abs(self)
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            if self > other { self } else { other }
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            if self < other { self } else { other }
        }
        #[inline(always)]
        fn copysign(self, sign: Self) -> Self {
            $t::copysign(self, sign)
        }
        #[inline(always)]
        fn lt(self, other: Self) -> bool {
            self < other
        }
        #[inline(always)]
        fn select(mask: bool, a: Self, b: Self) -> Self {
            if mask { a } else { b }
        }
        #[inline(always)]
        fn lookup(self, table: &[f32]) -> Self {
            $t::from(table[self as usize])
        }
    };
}

impl Real for f64 {
    real_common!(f64);
    #[inline(always)]
    fn ln(self) -> Self {
        f64::ln(self)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        f64::exp(self)
    }
    #[inline(always)]
    fn sin_cos_turn(self) -> (Self, Self) {
        (self * std::f64::consts::TAU).sin_cos()
    }
}

impl Real for f32 {
    real_common!(f32);

    #[inline(always)]
    fn ln(self) -> Self {
        let bits = self.to_bits();
        // self = 2^exponent * m with m within [sqrt(1/2), sqrt(2)).
        let shifted = bits.wrapping_sub(0x3f35_04f3);
        let exponent = ((shifted as i32) >> 23) as f32;
        let m = f32::from_bits((shifted & 0x007f_ffff).wrapping_add(0x3f35_04f3)) - 1.0;
        let z = m * m;
        let mut y = horner(
            m,
            [
                7.037_683_6e-2,
                -1.151_461e-1,
                1.167_699_9e-1,
                -1.242_014_1e-1,
                1.424_932_3e-1,
                -1.666_805_8e-1,
                2.000_071_5e-1,
                -2.499_999_4e-1,
                3.333_333e-1,
            ],
        ) * m
            * z;
        y = y - LN_2_LOW * exponent - 0.5 * z;
        m + y + LN_2_HIGH * exponent
    }

    #[inline(always)]
    fn exp(self) -> Self {
        let x = Real::min(Real::max(self, -87.3), 88.3);
        let shifted = x * std::f32::consts::LOG2_E + ROUND;
        let power = shifted - ROUND;
        let r = x - power * LN_2_HIGH + power * LN_2_LOW;
        let y = horner(r, [1.987_569_1e-4, 1.398_199_9e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_5e-1, 5.0e-1]);
        let two = f32::from_bits((shifted.to_bits() << 23).wrapping_add(0x3f80_0000));
        let value = (y * (r * r) + r + 1.0) * two;
        if self < -87.3 { 0.0 } else { value }
    }

    #[inline(always)]
    fn sin_cos_turn(self) -> (Self, Self) {
        // Quarter turns, and the rest within an eighth of a turn.
        let quarters = 4.0 * self;
        let shifted = quarters + ROUND;
        let r = (quarters - (shifted - ROUND)) * std::f32::consts::FRAC_PI_2;
        let quadrant = shifted.to_bits();
        let z = r * r;
        let sin = horner(z, [-1.951_529_6e-4, 8.332_161e-3, -1.666_665_5e-1]) * z * r + r;
        let cos = horner(z, [2.443_315_7e-5, -1.388_731_6e-3, 4.166_664_6e-2]) * z * z - 0.5 * z + 1.0;
        let odd = quadrant & 1 == 1;
        let (s, c) = if odd { (cos, sin) } else { (sin, cos) };
        let sign = |x: f32, quadrant: u32| f32::from_bits(x.to_bits() ^ ((quadrant & 2) << 30));
        (sign(s, quadrant), sign(c, quadrant.wrapping_add(1)))
    }
}

/// 1.5 * 2^23: added to a number below 2^22 it rounds it to an integer, which then is the lowest bits.
const ROUND: f32 = 12_582_912.0;
/// ln 2 = LN_2_HIGH - LN_2_LOW, the first with few bits.
const LN_2_HIGH: f32 = 0.693_359_4;
const LN_2_LOW: f32 = 2.121_944_4e-4;

/// The polynomial with the given coefficients, the highest power first.
#[inline(always)]
fn horner<const N: usize>(x: f32, coefficients: [f32; N]) -> f32 {
    let mut sum = coefficients[0];
    for i in 1..N {
        sum = sum * x + coefficients[i];
    }
    sum
}

/// The cell [i, i + 1) that holds `x`, 0 <= x < 2^22, without a conversion that vectors lack; an integer may count to the
/// cell below it (0 does not).
#[inline(always)]
pub fn cell(x: f32) -> i32 {
    ((x - 0.5) + ROUND).to_bits().wrapping_sub(ROUND.to_bits()) as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// f32 numbers over the whole range that a function is used in.
    fn sweep(from: f32, to: f32, n: u32) -> impl Iterator<Item = f32> {
        (0..=n).map(move |i| (from as f64 + (f64::from(to) - f64::from(from)) * f64::from(i) / f64::from(n)) as f32)
    }

    #[test]
    fn logarithm_is_right_to_two_units_in_the_last_place() {
        let uniform = sweep(0.0, 1.0, 1 << 20).skip(1);
        let tiny = (0..1 << 16).map(|i: u32| ((i + 1) as f32) * 2f32.powi(-41));
        let large = (0..120).map(|i| 1.7f32.powi(i));
        for x in uniform.chain(tiny).chain(large) {
            let exact = f64::from(x).ln();
            let error = (f64::from(Real::ln(x)) - exact).abs();
            assert!(error <= 2.0 * f64::from(f32::EPSILON) * exact.abs().max(2f64.powi(-24)), "ln {x}: {error}");
        }
    }

    #[test]
    fn exponential_is_right_to_two_units_in_the_last_place() {
        for x in sweep(-87.0, 88.0, 1 << 20) {
            let exact = f64::from(x).exp();
            let error = (f64::from(Real::exp(x)) - exact).abs();
            assert!(error <= 2.0 * f64::from(f32::EPSILON) * exact, "exp {x}: {}", error / exact);
        }
        assert_eq!([Real::exp(-88.0f32), Real::exp(f32::NEG_INFINITY), Real::exp(0.0f32)], [0.0, 0.0, 1.0]);
    }

    #[test]
    fn sine_and_cosine_are_right_to_1e_7() {
        for x in sweep(-1.0, 2.0, 3 << 19) {
            let (s, c) = x.sin_cos_turn();
            let (sin, cos) = f64::from(x).sin_cos_turn();
            assert!((f64::from(s) - sin).abs() < 1.3e-7 && (f64::from(c) - cos).abs() < 1.3e-7, "{x}: {s} {c}");
        }
    }

    #[test]
    fn cells_hold_their_numbers() {
        for x in sweep(0.0, 4000.0, 1 << 20) {
            let i = cell(x);
            assert!(i >= 0 && i as f32 <= x && x <= (i + 1) as f32, "{x}: {i}");
        }
        assert_eq!([cell(0.0), cell(0.999_999_94), cell(511.999_97)], [0, 0, 511]);
    }
}
