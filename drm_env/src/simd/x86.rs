//! Packs that are one vector register of an x86-64 processor.
//!
//! Compilers put arrays of numbers into vector registers by recognising patterns, which fails now
//! and then in long functions; here the operations are named. They become single instructions only
//! where they are inlined into a function that is compiled for the instruction set.
//!
//! Safety: a value of these types is made only after [`super::Instructions::detect`] has found the
//! instructions; the engine's batches and rollouts see to it.

use std::arch::x86_64::*;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use super::{BIASED, Lane, MANTISSA, ONE, SHIFTED, WIDEST, laned_number};

/// The intrinsics of one width.
macro_rules! wide {
    (
        $name:ident, $register:ty, $lanes:literal, $align:literal, $features:literal,
        add $add:ident, sub $sub:ident, mul $mul:ident, div $div:ident, fused $fused:ident,
        min $min:ident, max $max:ident, sqrt $sqrt:ident, splat $splat:ident,
        integers $integers:ident $floats:ident $word:ident $and:ident $or:ident $xor:ident
            $right:ident $left:ident,
        below $below:expr, where_set $where_set:expr, bits $bits:expr $(,)?
    ) => {
        #[doc = concat!(stringify!($lanes), " environments side by side, with ", $features, ".")]
        #[derive(Debug, Clone, Copy)]
        #[repr(C, align($align))]
        pub(crate) struct $name($register);

        impl $name {
            #[inline(always)]
            fn array(self) -> [f64; $lanes] {
                // SAFETY: a register of so many numbers has the size and bits of an array of them
                unsafe { std::mem::transmute::<$register, [f64; $lanes]>(self.0) }
            }

            #[inline(always)]
            fn of_array(array: [f64; $lanes]) -> Self {
                // SAFETY: as above, the other way round
                Self(unsafe { std::mem::transmute::<[f64; $lanes], $register>(array) })
            }
        }

        wide!(@operators $name, Add add $add, Sub sub $sub, Mul mul $mul, Div div $div);
        wide!(@scalars $name, Add add, Sub sub, Mul mul);

        impl Neg for $name {
            type Output = Self;

            #[inline(always)]
            fn neg(self) -> Self {
                // SAFETY: see the module
                unsafe {
                    let sign = $integers($splat(-0.0));
                    Self($floats($xor($integers(self.0), sign)))
                }
            }
        }

        impl AddAssign for $name {
            #[inline(always)]
            fn add_assign(&mut self, other: Self) {
                *self = *self + other;
            }
        }

        impl SubAssign for $name {
            #[inline(always)]
            fn sub_assign(&mut self, other: Self) {
                *self = *self - other;
            }
        }

        laned_number!(() $name);

        // SAFETY, of every block here: see the module
        #[allow(clippy::undocumented_unsafe_blocks)]
        impl Lane for $name {
            const WIDTH: usize = $lanes;

            #[inline(always)]
            fn splat(value: f64) -> Self {
                unsafe { Self($splat(value)) }
            }

            #[inline(always)]
            fn min(self, other: Self) -> Self {
                unsafe { Self($min(self.0, other.0)) }
            }

            #[inline(always)]
            fn max(self, other: Self) -> Self {
                unsafe { Self($max(self.0, other.0)) }
            }

            #[inline(always)]
            fn mul_add(self, factor: Self, addend: Self) -> Self {
                unsafe { Self($fused(self.0, factor.0, addend.0)) }
            }

            #[inline(always)]
            fn sqrt(self) -> Self {
                unsafe { Self($sqrt(self.0)) }
            }

            #[inline(always)]
            fn abs(self) -> Self {
                unsafe {
                    let magnitude = $word(i64::MAX);
                    Self($floats($and($integers(self.0), magnitude)))
                }
            }

            #[inline(always)]
            fn below(self, other: Self) -> Self {
                unsafe { Self($below(self.0, other.0)) }
            }

            #[inline(always)]
            fn where_set(self, condition: Self, other: Self) -> Self {
                unsafe { Self($where_set(self.0, condition.0, other.0)) }
            }

            #[inline(always)]
            fn bits(self) -> u32 {
                unsafe { $bits(self.0) }
            }

            #[inline(always)]
            fn split(self) -> (Self, Self) {
                unsafe {
                    let bits = $integers(self.0);
                    let mantissa = $or($and(bits, $word(MANTISSA as i64)), $word(ONE as i64));
                    let exponent = $or($right::<52>(bits), $word(SHIFTED as i64));
                    (
                        Self($floats(mantissa)),
                        Self($sub($floats(exponent), $splat(BIASED))),
                    )
                }
            }

            #[inline(always)]
            fn power_of_two(self) -> Self {
                unsafe {
                    let biased = $integers($add(self.0, $splat(BIASED)));
                    Self($floats($left::<52>(biased)))
                }
            }

            #[inline(always)]
            fn lane(&self, index: usize) -> f64 {
                self.array()[index]
            }

            #[inline(always)]
            fn set_lane(&mut self, index: usize, value: f64) {
                let mut array = self.array();
                array[index] = value;
                *self = Self::of_array(array);
            }

            #[inline(always)]
            fn of_lanes(values: &[f64; WIDEST]) -> Self {
                let mut array = [0.0; $lanes];
                array.copy_from_slice(&values[..$lanes]);
                Self::of_array(array)
            }
        }
    };
    (@operators $name:ident, $($trait:ident $method:ident $intrinsic:ident),+) => {$(
        impl $trait for $name {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: see the module
                unsafe { Self($intrinsic(self.0, other.0)) }
            }
        }
    )+};
    (@scalars $name:ident, $($trait:ident $method:ident),+) => {$(
        impl $trait<f64> for $name {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: f64) -> Self {
                $trait::$method(self, Self::splat(other))
            }
        }
    )+};
}

wide!(
    Wide8, __m512d, 8, 64, "AVX-512",
    add _mm512_add_pd, sub _mm512_sub_pd, mul _mm512_mul_pd, div _mm512_div_pd,
    fused _mm512_fmadd_pd, min _mm512_min_pd, max _mm512_max_pd, sqrt _mm512_sqrt_pd,
    splat _mm512_set1_pd,
    integers _mm512_castpd_si512 _mm512_castsi512_pd _mm512_set1_epi64 _mm512_and_si512
        _mm512_or_si512 _mm512_xor_si512 _mm512_srli_epi64 _mm512_slli_epi64,
    below |x, y| _mm512_maskz_mov_pd(
        _mm512_cmp_pd_mask::<_CMP_LT_OQ>(x, y),
        _mm512_set1_pd(1.0),
    ),
    where_set |x, condition, other| _mm512_mask_blend_pd(
        _mm512_cmp_pd_mask::<_CMP_NEQ_UQ>(condition, _mm512_setzero_pd()),
        other,
        x,
    ),
    bits |x| u32::from(_mm512_cmp_pd_mask::<_CMP_NEQ_UQ>(x, _mm512_setzero_pd())),
);

wide!(
    Wide4, __m256d, 4, 32, "AVX2",
    add _mm256_add_pd, sub _mm256_sub_pd, mul _mm256_mul_pd, div _mm256_div_pd,
    fused _mm256_fmadd_pd, min _mm256_min_pd, max _mm256_max_pd, sqrt _mm256_sqrt_pd,
    splat _mm256_set1_pd,
    integers _mm256_castpd_si256 _mm256_castsi256_pd _mm256_set1_epi64x _mm256_and_si256
        _mm256_or_si256 _mm256_xor_si256 _mm256_srli_epi64 _mm256_slli_epi64,
    below |x, y| _mm256_and_pd(
        _mm256_cmp_pd::<_CMP_LT_OQ>(x, y),
        _mm256_set1_pd(1.0),
    ),
    where_set |x, condition, other| _mm256_blendv_pd(
        other,
        x,
        _mm256_cmp_pd::<_CMP_NEQ_UQ>(condition, _mm256_setzero_pd()),
    ),
    bits |x| _mm256_movemask_pd(
        _mm256_cmp_pd::<_CMP_NEQ_UQ>(x, _mm256_setzero_pd()),
    ) as u32,
);
