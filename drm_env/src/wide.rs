//! Eight environments side by side in the registers of a processor: what [`Pack`] does, in that
//! processor's instructions.
//!
//! The compiler finds such instructions for a [`Pack`]'s eight numbers in short functions, and not
//! dependably in long ones. Every operation is the IEEE one of [`Lane`], so the bits are the same.
//!
//! Arithmetic on these lanes must be reached only on a processor that has the instructions, from a
//! function compiled for it into which everything is inlined. Storing and reading lanes works anywhere.

use std::arch::x86_64::*;
use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use crate::lane::{Lane, Pack};

/// Eight numbers for `avx512f,avx512dq`.
pub type Avx512 = Wide<__m512d, 1>;
/// Eight numbers for `avx2,fma`.
pub type Avx2 = Wide<__m256d, 2>;

const WIDTH: usize = 8;

/// Eight numbers in `K` registers.
#[derive(Debug, Clone, Copy)]
#[repr(transparent)]
pub struct Wide<R, const K: usize>([R; K]);

/// One register.
pub trait Register: Copy + Debug + Send + Sync + 'static {
    /// The same number everywhere.
    fn splat(value: f64) -> Self;
    /// Sum.
    fn add(self, other: Self) -> Self;
    /// Difference.
    fn sub(self, other: Self) -> Self;
    /// Product.
    fn mul(self, other: Self) -> Self;
    /// Quotient.
    fn div(self, other: Self) -> Self;
    /// The smaller; `other` where they are not ordered.
    fn min(self, other: Self) -> Self;
    /// The larger; `other` where they are not ordered.
    fn max(self, other: Self) -> Self;
    /// `self * factor + addend`, rounded once.
    fn fma(self, factor: Self, addend: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Without sign.
    fn abs(self) -> Self;
    /// With the other sign.
    fn neg(self) -> Self;
    /// `self` where `condition` is not zero.
    fn select(self, condition: Self, other: Self) -> Self;
    /// 1 where `self < other`, 0 elsewhere.
    fn below(self, other: Self) -> Self;
}

// SAFETY, for all of both: who computes with these lanes is on a processor that can (see the module)
#[allow(clippy::undocumented_unsafe_blocks)]
impl Register for __m512d {
    #[inline(always)]
    fn splat(value: f64) -> Self {
        unsafe { _mm512_set1_pd(value) }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        unsafe { _mm512_add_pd(self, other) }
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        unsafe { _mm512_sub_pd(self, other) }
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        unsafe { _mm512_mul_pd(self, other) }
    }

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        unsafe { _mm512_div_pd(self, other) }
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        unsafe { _mm512_min_pd(self, other) }
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        unsafe { _mm512_max_pd(self, other) }
    }

    #[inline(always)]
    fn fma(self, factor: Self, addend: Self) -> Self {
        unsafe { _mm512_fmadd_pd(self, factor, addend) }
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        unsafe { _mm512_sqrt_pd(self) }
    }

    #[inline(always)]
    fn abs(self) -> Self {
        unsafe { _mm512_abs_pd(self) }
    }

    #[inline(always)]
    fn neg(self) -> Self {
        unsafe { _mm512_xor_pd(self, _mm512_set1_pd(-0.0)) }
    }

    #[inline(always)]
    fn select(self, condition: Self, other: Self) -> Self {
        unsafe {
            let set = _mm512_cmp_pd_mask::<_CMP_NEQ_UQ>(condition, _mm512_setzero_pd());
            _mm512_mask_blend_pd(set, other, self)
        }
    }

    #[inline(always)]
    fn below(self, other: Self) -> Self {
        unsafe {
            let set = _mm512_cmp_pd_mask::<_CMP_LT_OQ>(self, other);
            _mm512_maskz_mov_pd(set, _mm512_set1_pd(1.0))
        }
    }
}

#[allow(clippy::undocumented_unsafe_blocks)]
impl Register for __m256d {
    #[inline(always)]
    fn splat(value: f64) -> Self {
        unsafe { _mm256_set1_pd(value) }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        unsafe { _mm256_add_pd(self, other) }
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        unsafe { _mm256_sub_pd(self, other) }
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        unsafe { _mm256_mul_pd(self, other) }
    }

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        unsafe { _mm256_div_pd(self, other) }
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        unsafe { _mm256_min_pd(self, other) }
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        unsafe { _mm256_max_pd(self, other) }
    }

    #[inline(always)]
    fn fma(self, factor: Self, addend: Self) -> Self {
        unsafe { _mm256_fmadd_pd(self, factor, addend) }
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        unsafe { _mm256_sqrt_pd(self) }
    }

    #[inline(always)]
    fn abs(self) -> Self {
        unsafe { _mm256_andnot_pd(_mm256_set1_pd(-0.0), self) }
    }

    #[inline(always)]
    fn neg(self) -> Self {
        unsafe { _mm256_xor_pd(self, _mm256_set1_pd(-0.0)) }
    }

    #[inline(always)]
    fn select(self, condition: Self, other: Self) -> Self {
        unsafe {
            let set = _mm256_cmp_pd::<_CMP_NEQ_UQ>(condition, _mm256_setzero_pd());
            _mm256_blendv_pd(other, self, set)
        }
    }

    #[inline(always)]
    fn below(self, other: Self) -> Self {
        unsafe {
            let set = _mm256_cmp_pd::<_CMP_LT_OQ>(self, other);
            _mm256_and_pd(set, _mm256_set1_pd(1.0))
        }
    }
}

impl<R: Register, const K: usize> From<Pack<WIDTH>> for Wide<R, K> {
    #[inline(always)]
    fn from(pack: Pack<WIDTH>) -> Self {
        const { assert!(size_of::<Self>() == size_of::<Pack<WIDTH>>()) };
        // SAFETY: both are eight numbers in the order of their lanes
        unsafe { std::mem::transmute_copy(&pack) }
    }
}

impl<R: Register, const K: usize> From<Wide<R, K>> for Pack<WIDTH> {
    #[inline(always)]
    fn from(wide: Wide<R, K>) -> Self {
        const { assert!(size_of::<Wide<R, K>>() == size_of::<Pack<WIDTH>>()) };
        let mut lanes = [0.0; WIDTH];
        // SAFETY: both are eight numbers in the order of their lanes
        unsafe {
            let from = std::ptr::from_ref(&wide).cast::<f64>();
            std::ptr::copy_nonoverlapping(from, lanes.as_mut_ptr(), WIDTH);
        }
        Self(lanes)
    }
}

macro_rules! operator {
    ($($trait:ident $method:ident),*) => {$(
        impl<R: Register, const K: usize> $trait for Wide<R, K> {
            type Output = Self;

            #[inline(always)]
            fn $method(mut self, other: Self) -> Self {
                for i in 0..K {
                    self.0[i] = self.0[i].$method(other.0[i]);
                }
                self
            }
        }
    )*};
}

macro_rules! scalar_operator {
    ($($trait:ident $method:ident),*) => {$(
        impl<R: Register, const K: usize> $trait<f64> for Wide<R, K> {
            type Output = Self;

            #[inline(always)]
            fn $method(mut self, other: f64) -> Self {
                for i in 0..K {
                    self.0[i] = self.0[i].$method(R::splat(other));
                }
                self
            }
        }
    )*};
}

operator!(Add add, Sub sub, Mul mul, Div div);
scalar_operator!(Add add, Sub sub, Mul mul);

impl<R: Register, const K: usize> Neg for Wide<R, K> {
    type Output = Self;

    #[inline(always)]
    fn neg(mut self) -> Self {
        for i in 0..K {
            self.0[i] = self.0[i].neg();
        }
        self
    }
}

impl<R: Register, const K: usize> AddAssign for Wide<R, K> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<R: Register, const K: usize> SubAssign for Wide<R, K> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl<R: Register, const K: usize> Lane for Wide<R, K> {
    const WIDTH: usize = WIDTH;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self([R::splat(value); K])
    }

    #[inline(always)]
    fn min(mut self, other: Self) -> Self {
        for i in 0..K {
            self.0[i] = self.0[i].min(other.0[i]);
        }
        self
    }

    #[inline(always)]
    fn max(mut self, other: Self) -> Self {
        for i in 0..K {
            self.0[i] = self.0[i].max(other.0[i]);
        }
        self
    }

    #[inline(always)]
    fn mul_add(mut self, factor: Self, addend: Self) -> Self {
        for i in 0..K {
            self.0[i] = self.0[i].fma(factor.0[i], addend.0[i]);
        }
        self
    }

    #[inline(always)]
    fn sqrt(mut self) -> Self {
        for i in 0..K {
            self.0[i] = self.0[i].sqrt();
        }
        self
    }

    #[inline(always)]
    fn abs(mut self) -> Self {
        for i in 0..K {
            self.0[i] = self.0[i].abs();
        }
        self
    }

    #[inline(always)]
    fn where_set(mut self, condition: Self, other: Self) -> Self {
        for i in 0..K {
            self.0[i] = self.0[i].select(condition.0[i], other.0[i]);
        }
        self
    }

    #[inline(always)]
    fn below(mut self, other: Self) -> Self {
        for i in 0..K {
            self.0[i] = self.0[i].below(other.0[i]);
        }
        self
    }

    #[inline(always)]
    fn lane(&self, index: usize) -> f64 {
        Pack::from(*self).0[index]
    }

    #[inline(always)]
    fn set_lane(&mut self, index: usize, value: f64) {
        let mut pack = Pack::from(*self);
        pack.0[index] = value;
        *self = pack.into();
    }
}
