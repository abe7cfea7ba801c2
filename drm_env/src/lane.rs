//! The number type of the physics: one environment (`f64`) or several side by side ([`Pack`]).
//!
//! Every operation of a pack is the same IEEE operation on each of its lanes, in the same order as
//! for a plain `f64`, so a lane's bits do not depend on the width. Multiplications and additions are
//! fused where [`Lane::mul_add`] is written and nowhere else: a processor without that instruction
//! computes the same bits, slowly.

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// Arithmetic that the plant, the integrator, the wheels and the laws are written in.
pub trait Lane:
    Copy
    + Send
    + Sync
    + std::fmt::Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + 'static
{
    /// Environments side by side.
    const WIDTH: usize;
    /// The same value in every lane.
    fn splat(value: f64) -> Self;
    /// The smaller of the two, lane by lane.
    fn min(self, other: Self) -> Self;
    /// The larger of the two, lane by lane.
    fn max(self, other: Self) -> Self;
    /// `self * factor + addend`, rounded once.
    fn mul_add(self, factor: Self, addend: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Magnitude.
    fn abs(self) -> Self;
    /// `self` where `condition` is not zero, `other` where it is, lane by lane.
    fn where_set(self, condition: Self, other: Self) -> Self;
    /// 1 where `self < other`, 0 elsewhere (and where either is not a number).
    fn below(self, other: Self) -> Self;
    /// Value of lane `index`.
    fn lane(&self, index: usize) -> f64;
    /// Sets lane `index`.
    fn set_lane(&mut self, index: usize, value: f64);

    /// `1 / self`.
    #[inline(always)]
    fn recip(self) -> Self {
        Self::splat(1.0) / self
    }

    /// Limits to `low ..= high`, lane by lane.
    #[inline(always)]
    fn limited(self, low: Self, high: Self) -> Self {
        self.max(low).min(high)
    }
}

impl Lane for f64 {
    const WIDTH: usize = 1;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        f64::mul_add(self, factor, addend)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }

    #[inline(always)]
    fn where_set(self, condition: Self, other: Self) -> Self {
        if condition != 0.0 { self } else { other }
    }

    #[inline(always)]
    fn below(self, other: Self) -> Self {
        if self < other { 1.0 } else { 0.0 }
    }

    #[inline(always)]
    fn lane(&self, _index: usize) -> f64 {
        *self
    }

    #[inline(always)]
    fn set_lane(&mut self, _index: usize, value: f64) {
        *self = value;
    }
}

/// `N` environments side by side; arithmetic acts on each lane alone.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub struct Pack<const N: usize>(pub [f64; N]);

macro_rules! pack_operator {
    ($($trait:ident $method:ident $operator:tt),*) => {$(
        impl<const N: usize> $trait for Pack<N> {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(std::array::from_fn(|i| self.0[i] $operator other.0[i]))
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
                Self(std::array::from_fn(|i| self.0[i] $operator other))
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
        Self(std::array::from_fn(|i| -self.0[i]))
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

impl<const N: usize> Lane for Pack<N> {
    const WIDTH: usize = N;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self([value; N])
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| Lane::min(self.0[i], other.0[i])))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| Lane::max(self.0[i], other.0[i])))
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        Self(std::array::from_fn(|i| {
            f64::mul_add(self.0[i], factor.0[i], addend.0[i])
        }))
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(std::array::from_fn(|i| f64::sqrt(self.0[i])))
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(std::array::from_fn(|i| f64::abs(self.0[i])))
    }

    #[inline(always)]
    fn where_set(self, condition: Self, other: Self) -> Self {
        Self(std::array::from_fn(|i| {
            Lane::where_set(self.0[i], condition.0[i], other.0[i])
        }))
    }

    #[inline(always)]
    fn below(self, other: Self) -> Self {
        Self(std::array::from_fn(|i| Lane::below(self.0[i], other.0[i])))
    }

    #[inline(always)]
    fn lane(&self, index: usize) -> f64 {
        self.0[index]
    }

    #[inline(always)]
    fn set_lane(&mut self, index: usize, value: f64) {
        self.0[index] = value;
    }
}
