//! Two packs in one, for tests: as many lanes as another width has, with fewer at a time.

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use super::{Lane, Laned, WIDEST};

/// Two packs side by side; the first has the lower lanes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Paired<L>(pub L, pub L);

macro_rules! twin_operator {
    ($($trait:ident $method:ident),*) => {$(
        impl<L: Lane> $trait for Paired<L> {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self($trait::$method(self.0, other.0), $trait::$method(self.1, other.1))
            }
        }
    )*};
}

macro_rules! twin_scalar_operator {
    ($($trait:ident $method:ident),*) => {$(
        impl<L: Lane> $trait<f64> for Paired<L> {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: f64) -> Self {
                Self($trait::$method(self.0, other), $trait::$method(self.1, other))
            }
        }
    )*};
}

twin_operator!(Add add, Sub sub, Mul mul, Div div);
twin_scalar_operator!(Add add, Sub sub, Mul mul);

impl<L: Lane> Neg for Paired<L> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0, -self.1)
    }
}

impl<L: Lane> AddAssign for Paired<L> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<L: Lane> SubAssign for Paired<L> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl<L: Lane> Laned for Paired<L> {
    type Single = f64;

    #[inline(always)]
    fn spread(single: &f64) -> Self {
        Self::splat(*single)
    }

    #[inline(always)]
    fn lane_of(&self, index: usize) -> f64 {
        self.lane(index)
    }

    #[inline(always)]
    fn put_lane(&mut self, index: usize, single: &f64) {
        self.set_lane(index, *single);
    }
}

impl<L: Lane> Lane for Paired<L> {
    const WIDTH: usize = 2 * L::WIDTH;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self(L::splat(value), L::splat(value))
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0), self.1.min(other.1))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0), self.1.max(other.1))
    }

    #[inline(always)]
    fn mul_add(self, factor: Self, addend: Self) -> Self {
        Self(
            self.0.mul_add(factor.0, addend.0),
            self.1.mul_add(factor.1, addend.1),
        )
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt(), self.1.sqrt())
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.abs(), self.1.abs())
    }

    #[inline(always)]
    fn below(self, other: Self) -> Self {
        Self(self.0.below(other.0), self.1.below(other.1))
    }

    #[inline(always)]
    fn where_set(self, condition: Self, other: Self) -> Self {
        Self(
            self.0.where_set(condition.0, other.0),
            self.1.where_set(condition.1, other.1),
        )
    }

    #[inline(always)]
    fn bits(self) -> u32 {
        self.0.bits() | (self.1.bits() << L::WIDTH)
    }

    #[inline(always)]
    fn split(self) -> (Self, Self) {
        let (first, second) = (self.0.split(), self.1.split());
        (Self(first.0, second.0), Self(first.1, second.1))
    }

    #[inline(always)]
    fn power_of_two(self) -> Self {
        Self(self.0.power_of_two(), self.1.power_of_two())
    }

    #[inline(always)]
    fn lane(&self, index: usize) -> f64 {
        if index < L::WIDTH {
            self.0.lane(index)
        } else {
            self.1.lane(index - L::WIDTH)
        }
    }

    #[inline(always)]
    fn set_lane(&mut self, index: usize, value: f64) {
        if index < L::WIDTH {
            self.0.set_lane(index, value);
        } else {
            self.1.set_lane(index - L::WIDTH, value);
        }
    }

    #[inline(always)]
    fn of_lanes(values: &[f64; WIDEST]) -> Self {
        let mut second = [0.0; WIDEST];
        second[..L::WIDTH].copy_from_slice(&values[L::WIDTH..2 * L::WIDTH]);
        Self(L::of_lanes(values), L::of_lanes(&second))
    }
}
