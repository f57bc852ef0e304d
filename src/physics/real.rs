//! The number that the physics is generic over: one photon in `f64` or `f32`, or several in [`Lanes`].

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A real number, or a lane vector of them. Branches are written with [`Real::select`] so that lanes can follow.
pub trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// The outcome of a comparison, one per lane.
    type Mask: Copy;
    /// A constant.
    fn of(x: f64) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// The larger of two.
    fn max(self, other: Self) -> Self;
    /// The smaller of two.
    fn min(self, other: Self) -> Self;
    /// The magnitude of `self` with the sign of `sign`.
    fn copysign(self, sign: Self) -> Self;
    /// Sine and cosine of 2 pi `self`.
    fn sin_cos_turn(self) -> (Self, Self);
    /// `self < other`.
    fn lt(self, other: Self) -> Self::Mask;
    /// `a` where the mask holds, else `b`.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;
    /// The entry of a table at the index `floor(self)`, which must lie within it.
    fn lookup(self, table: &[f32]) -> Self;
    /// Largest integer not above.
    fn floor(self) -> Self;
}

macro_rules! real_scalar {
    ($t:ident) => {
        impl Real for $t {
            type Mask = bool;
            #[inline(always)]
            fn of(x: f64) -> Self {
                x as $t
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                $t::sqrt(self)
            }
            #[inline(always)]
            fn ln(self) -> Self {
                $t::ln(self)
            }
            #[inline(always)]
            fn abs(self) -> Self {
                $t::abs(self)
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                $t::max(self, other)
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                $t::min(self, other)
            }
            #[inline(always)]
            fn copysign(self, sign: Self) -> Self {
                $t::copysign(self, sign)
            }
            #[inline(always)]
            fn sin_cos_turn(self) -> (Self, Self) {
                (self * std::$t::consts::TAU).sin_cos()
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
            #[inline(always)]
            fn floor(self) -> Self {
                $t::floor(self)
            }
        }
    };
}
real_scalar!(f32);
real_scalar!(f64);

/// `N` numbers that are walked together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lanes<const N: usize>(pub [f32; N]);

impl<const N: usize> Lanes<N> {
    #[inline(always)]
    fn map(self, f: impl Fn(f32) -> f32) -> Self {
        let mut out = self.0;
        for lane in 0..N {
            out[lane] = f(self.0[lane]);
        }
        Lanes(out)
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = self.0;
        for lane in 0..N {
            out[lane] = f(self.0[lane], other.0[lane]);
        }
        Lanes(out)
    }
}

macro_rules! lane_operator {
    ($($op:ident $f:ident),*) => {$(
        impl<const N: usize> $op for Lanes<N> {
            type Output = Self;
            #[inline(always)]
            fn $f(self, other: Self) -> Self {
                self.zip(other, |a, b| a.$f(b))
            }
        }
    )*};
}
lane_operator!(Add add, Sub sub, Mul mul, Div div);

impl<const N: usize> Neg for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|a| -a)
    }
}

impl<const N: usize> Real for Lanes<N> {
    type Mask = [bool; N];
    #[inline(always)]
    fn of(x: f64) -> Self {
        Lanes([x as f32; N])
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.map(f32::sqrt)
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.map(f32::ln)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.map(f32::abs)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, f32::max)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, f32::min)
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        self.zip(sign, f32::copysign)
    }
    #[inline(always)]
    fn sin_cos_turn(self) -> (Self, Self) {
        (self.map(|x| x.sin_cos_turn().0), self.map(|x| x.sin_cos_turn().1))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> [bool; N] {
        let mut mask = [false; N];
        for lane in 0..N {
            mask[lane] = self.0[lane] < other.0[lane];
        }
        mask
    }
    #[inline(always)]
    fn select(mask: [bool; N], a: Self, b: Self) -> Self {
        let mut out = b;
        for lane in 0..N {
            if mask[lane] {
                out.0[lane] = a.0[lane];
            }
        }
        out
    }
    #[inline(always)]
    fn lookup(self, table: &[f32]) -> Self {
        self.map(|i| table[i as usize])
    }
    #[inline(always)]
    fn floor(self) -> Self {
        self.map(f32::floor)
    }
}
