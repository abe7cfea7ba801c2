//! Packs as arrays of plain numbers.

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use super::{Lane, WIDEST, laned_number};

/// `N` environments side by side; arithmetic acts on each lane alone.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(16))]
pub struct Pack<const N: usize>(pub [f64; N]);

/// One expression for each lane. Many lanes are a loop: a closure, as of `array::from_fn`, is compiled
/// without the instructions of the code around it whenever the compiler does not inline it. Two lanes are
/// what every processor has: there is nothing to lose, and the code, which stands in every kind of work,
/// stays small.
macro_rules! each_lane {
    ($i:ident in $lanes:ident: $value:expr) => {{
        if $lanes == 2 {
            Self(std::array::from_fn(|$i| $value))
        } else {
            let mut values = [0.0; $lanes];
            for $i in 0..$lanes {
                values[$i] = $value;
            }
            Self(values)
        }
    }};
}

macro_rules! pack_operator {
    ($($trait:ident $method:ident $operator:tt),*) => {$(
        impl<const N: usize> $trait for Pack<N> {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                each_lane!(i in N: self.0[i] $operator other.0[i])
            }
        }
    )*};
}

macro_rules! pack_scalar_operator {
    ($($trait:ident $method:ident $operator:tt),*) => {$(
        impl<const N: usize> $trait<f64> for Pack<N> {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: f64) -> Self {
                each_lane!(i in N: self.0[i] $operator other)
            }
        }
    )*};
}

pack_operator!(Add add +, Sub sub -, Mul mul *, Div div /);
pack_scalar_operator!(Add add +, Sub sub -, Mul mul *);

impl<const N: usize> Neg for Pack<N> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        each_lane!(i in N: -self.0[i])
    }
}

impl<const N: usize> AddAssign for Pack<N> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<const N: usize> SubAssign for Pack<N> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

laned_number!((const N: usize) Pack<N>);

impl<const N: usize> Lane for Pack<N> {
    const WIDTH: usize = N;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self([value; N])
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        each_lane!(i in N: Lane::min(self.0[i], other.0[i]))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        each_lane!(i in N: Lane::max(self.0[i], other.0[i]))
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        each_lane!(i in N: f64::mul_add(self.0[i], factor.0[i], addend.0[i]))
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        each_lane!(i in N: f64::sqrt(self.0[i]))
    }

    #[inline(always)]
    fn abs(self) -> Self {
        each_lane!(i in N: f64::abs(self.0[i]))
    }

    #[inline(always)]
    fn below(self, other: Self) -> Self {
        each_lane!(i in N: Lane::below(self.0[i], other.0[i]))
    }

    #[inline(always)]
    fn where_set(self, condition: Self, other: Self) -> Self {
        each_lane!(i in N: Lane::where_set(self.0[i], condition.0[i], other.0[i]))
    }

    #[inline(always)]
    fn bits(self) -> u32 {
        let mut bits = 0;
        for i in 0..N {
            bits |= Lane::bits(self.0[i]) << i;
        }
        bits
    }

    #[inline(always)]
    fn split(self) -> (Self, Self) {
        (
            each_lane!(i in N: self.0[i].split().0),
            each_lane!(i in N: self.0[i].split().1),
        )
    }

    #[inline(always)]
    fn power_of_two(self) -> Self {
        each_lane!(i in N: Lane::power_of_two(self.0[i]))
    }

    #[inline(always)]
    fn lane(&self, index: usize) -> f64 {
        self.0[index]
    }

    #[inline(always)]
    fn set_lane(&mut self, index: usize, value: f64) {
        self.0[index] = value;
    }

    #[inline(always)]
    fn of_lanes(values: &[f64; WIDEST]) -> Self {
        each_lane!(i in N: values[i])
    }
}
