//! The number type of the physics: one environment (`f64`) or several side by side.
//!
//! Every operation of a pack is the same IEEE operation on each of its lanes, in the same order as
//! for a plain `f64`, so a lane's bits do not depend on the width. Multiplications and additions are
//! fused where [`Lane::mul_add`] is written and nowhere else: a processor without that instruction
//! computes the same bits, slowly.
//!
//! [`Pack`] runs anywhere; `x86` has the packs that are one vector register of a processor.

pub(crate) mod dispatch;
pub mod functions;
pub(crate) mod mask;
mod pack;
#[cfg(test)]
pub(crate) mod paired;
#[cfg(all(target_arch = "wasm32", target_feature = "relaxed-simd"))]
mod relaxed;
#[cfg(target_arch = "x86_64")]
pub(crate) mod x86;

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};
use std::sync::OnceLock;

use crate::error::ConfigError;

pub use pack::Pack;

/// The pack of processors without an instruction set of their own here.
#[cfg(not(target_arch = "wasm32"))]
pub type Narrow = Pack<2>;
/// WebAssembly has no fused multiplication of two numbers: a pack would gain nothing.
#[cfg(target_arch = "wasm32")]
pub type Narrow = f64;

/// 2^52 + 1023: added to a small integer it leaves integer and exponent bias in the last bits.
const BIASED: f64 = 4_503_599_627_371_519.0;
/// Bits of the mantissa, and of 1 without them.
const MANTISSA: u64 = 0x000f_ffff_ffff_ffff;
const ONE: u64 = 0x3ff0_0000_0000_0000;
/// Bits of 2^52.
const SHIFTED: u64 = 0x4330_0000_0000_0000;

/// Environments in the widest pack.
pub const WIDEST: usize = 8;

/// Arithmetic that the plant, the integrator, the wheels, the laws and the task are written in.
pub trait Lane:
    Copy
    + Send
    + Sync
    + Debug
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
    /// The smaller of the two, lane by lane; `other` if either is not a number.
    fn min(self, other: Self) -> Self;
    /// The larger of the two, lane by lane; `other` if either is not a number.
    fn max(self, other: Self) -> Self;
    /// `self * factor + addend`, rounded once.
    fn mul_add(self, factor: Self, addend: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Magnitude.
    fn abs(self) -> Self;
    /// 1 where `self < other`, 0 elsewhere (and where either is not a number).
    fn below(self, other: Self) -> Self;
    /// `self` where `condition` is not zero, `other` where it is, lane by lane.
    fn where_set(self, condition: Self, other: Self) -> Self;
    /// A bit for each lane that is not zero, the lowest that of lane 0.
    fn bits(self) -> u32;
    /// Mantissa in 1..2 and exponent of positive normal numbers: `mantissa * 2^exponent`.
    fn split(self) -> (Self, Self);
    /// 2^self of whole numbers within the range of normal exponents.
    fn power_of_two(self) -> Self;
    /// Value of lane `index`.
    fn lane(&self, index: usize) -> f64;
    /// Sets lane `index`.
    fn set_lane(&mut self, index: usize, value: f64);
    /// The first of these numbers, one a lane. Lane after lane would be slow: the pack goes to memory and
    /// comes back each time.
    fn of_lanes(values: &[f64; WIDEST]) -> Self;

    /// `1 / self`.
    #[inline(always)]
    fn recip(self) -> Self {
        Self::splat(1.0) / self
    }

    /// `addend - self * factor`, rounded once.
    #[inline(always)]
    fn negated_mul_add(self, factor: Self, addend: Self) -> Self {
        (-self).mul_add(factor, addend)
    }

    /// Limits to `low ..= high`, lane by lane.
    #[inline(always)]
    fn limited(self, low: Self, high: Self) -> Self {
        self.max(low).min(high)
    }

    /// `c[0] + c[1] self + c[2] self^2 + ...` by Horner's rule.
    #[inline(always)]
    fn polynomial<const N: usize>(self, c: &[Self; N]) -> Self {
        let mut sum = c[N - 1];
        for i in (0..N - 1).rev() {
            sum = sum.mul_add(self, c[i]);
        }
        sum
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
        #[cfg(all(target_arch = "wasm32", target_feature = "relaxed-simd"))]
        return relaxed::mul_add(self, factor, addend);
        #[cfg(not(all(target_arch = "wasm32", target_feature = "relaxed-simd")))]
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
    fn below(self, other: Self) -> Self {
        if self < other { 1.0 } else { 0.0 }
    }

    #[inline(always)]
    fn where_set(self, condition: Self, other: Self) -> Self {
        if condition != 0.0 { self } else { other }
    }

    #[inline(always)]
    fn bits(self) -> u32 {
        u32::from(self != 0.0)
    }

    #[inline(always)]
    fn split(self) -> (Self, Self) {
        let bits = self.to_bits();
        (
            f64::from_bits((bits & MANTISSA) | ONE),
            f64::from_bits((bits >> 52) | SHIFTED) - BIASED,
        )
    }

    #[inline(always)]
    fn power_of_two(self) -> Self {
        f64::from_bits((self + BIASED).to_bits() << 52)
    }

    #[inline(always)]
    fn lane(&self, _index: usize) -> f64 {
        *self
    }

    #[inline(always)]
    fn set_lane(&mut self, _index: usize, value: f64) {
        *self = value;
    }

    #[inline(always)]
    fn of_lanes(values: &[f64; WIDEST]) -> Self {
        values[0]
    }
}

/// Whether multiplications and additions are fused here, so that numbers have the bits of every other machine.
/// A WebAssembly module with relaxed instructions cannot be sure.
pub fn is_fused() -> bool {
    let a = std::hint::black_box(1.0 + f64::EPSILON);
    // (1 + e)^2 - (1 + 2 e) = e^2, and 0 if the square is rounded first
    let rest = Lane::mul_add(a, a, -(1.0 + 2.0 * f64::EPSILON));
    rest == f64::EPSILON * f64::EPSILON
}

/// Values of several lanes side by side, of which single ones can be taken out and put in.
pub trait Laned: Copy {
    /// The same of one lane.
    type Single: Copy;
    /// The same in every lane.
    fn spread(single: &Self::Single) -> Self;
    /// One lane.
    fn lane_of(&self, index: usize) -> Self::Single;
    /// Replaces one lane.
    fn put_lane(&mut self, index: usize, single: &Self::Single);
}

/// `f64` and the packs are themselves what they hold in each lane.
macro_rules! laned_number {
    ($(($($generic:tt)*) $type:ty),+ $(,)?) => {$(
        impl<$($generic)*> $crate::simd::Laned for $type {
            type Single = f64;

            #[inline(always)]
            fn spread(single: &f64) -> Self {
                <Self as $crate::simd::Lane>::splat(*single)
            }

            #[inline(always)]
            fn lane_of(&self, index: usize) -> f64 {
                $crate::simd::Lane::lane(self, index)
            }

            #[inline(always)]
            fn put_lane(&mut self, index: usize, single: &f64) {
                $crate::simd::Lane::set_lane(self, index, *single);
            }
        }
    )+};
}
pub(crate) use laned_number;

laned_number!(() f64);

impl<L: Laned, const N: usize> Laned for [L; N] {
    type Single = [L::Single; N];

    #[inline(always)]
    fn spread(single: &Self::Single) -> Self {
        let mut all = [L::spread(&single[0]); N];
        for i in 1..N {
            all[i] = L::spread(&single[i]);
        }
        all
    }

    #[inline(always)]
    fn lane_of(&self, index: usize) -> Self::Single {
        let mut single = [self[0].lane_of(index); N];
        for i in 1..N {
            single[i] = self[i].lane_of(index);
        }
        single
    }

    #[inline(always)]
    fn put_lane(&mut self, index: usize, single: &Self::Single) {
        for i in 0..N {
            self[i].put_lane(index, &single[i]);
        }
    }
}

/// `Laned` for a struct over its lane type, field by field.
macro_rules! laned {
    ($name:ident { $($field:ident),+ $(,)? }) => {
        impl<T> $crate::simd::Laned for $name<T>
        where
            T: $crate::simd::Lane + $crate::simd::Laned<Single = f64>,
        {
            type Single = $name<f64>;

            #[inline(always)]
            fn spread(single: &$name<f64>) -> Self {
                Self { $($field: $crate::simd::Laned::spread(&single.$field)),+ }
            }

            #[inline(always)]
            fn lane_of(&self, index: usize) -> $name<f64> {
                $name { $($field: $crate::simd::Laned::lane_of(&self.$field, index)),+ }
            }

            #[inline(always)]
            fn put_lane(&mut self, index: usize, single: &$name<f64>) {
                $($crate::simd::Laned::put_lane(&mut self.$field, index, &single.$field);)+
            }
        }
    };
}
pub(crate) use laned;

/// Number types that fit into the structures of the engine.
pub trait Number: Lane + Laned<Single = f64> {}

impl<T: Lane + Laned<Single = f64>> Number for T {}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Every operation on a pack against the same on plain numbers, bit by bit.
    fn same_bits<T: Number>(x: [f64; 8], y: [f64; 8], z: [f64; 8]) {
        let pack = |values: [f64; 8]| {
            let mut pack = T::splat(0.0);
            for (lane, value) in values.iter().take(T::WIDTH).enumerate() {
                pack.set_lane(lane, *value);
            }
            pack
        };
        let (a, b, c) = (pack(x), pack(y), pack(z));
        let results = [
            a + b,
            a - b,
            a * b,
            a / b,
            a + 2.5,
            a - 2.5,
            a * 2.5,
            -a,
            a.min(b),
            a.max(b),
            a.mul_add(b, c),
            a.negated_mul_add(b, c),
            a.abs().sqrt(),
            a.abs(),
            a.below(b),
            a.where_set(a.below(b), c),
            a.recip(),
            a.polynomial(&[b, c, a]),
            a.abs().split().0,
            a.abs().split().1,
            a.abs().split().1.power_of_two(),
            T::of_lanes(&x),
        ];
        for lane in 0..T::WIDTH {
            let (p, q, r) = (x[lane], y[lane], z[lane]);
            let expected = [
                p + q,
                p - q,
                p * q,
                p / q,
                p + 2.5,
                p - 2.5,
                p * 2.5,
                -p,
                Lane::min(p, q),
                Lane::max(p, q),
                f64::mul_add(p, q, r),
                f64::mul_add(-p, q, r),
                p.abs().sqrt(),
                p.abs(),
                Lane::below(p, q),
                Lane::where_set(p, Lane::below(p, q), r),
                p.recip(),
                p.polynomial(&[q, r, p]),
                p.abs().split().0,
                p.abs().split().1,
                p.abs().split().1.power_of_two(),
                p,
            ];
            for (i, (result, expected)) in results.iter().zip(expected).enumerate() {
                assert_eq!(result.lane(lane).to_bits(), expected.to_bits(), "{i}");
            }
            let below = (a.below(b).bits() >> lane) & 1;
            assert_eq!(below == 1, p < q);
        }
    }

    proptest! {
        #[test]
        fn packs_compute_the_bits_of_plain_numbers(
            x in proptest::array::uniform8(-1e6..1e6_f64),
            y in proptest::array::uniform8(-1e3..1e3_f64),
            z in proptest::array::uniform8(-1e9..1e9_f64),
        ) {
            prop_assume!(x.iter().chain(&y).all(|value| value.abs() > 1e-6));
            same_bits::<f64>(x, y, z);
            same_bits::<Pack<2>>(x, y, z);
            same_bits::<Pack<8>>(x, y, z);
            same_bits::<paired::Paired<Pack<2>>>(x, y, z);
            #[cfg(target_arch = "x86_64")]
            {
                if Instructions::detect() >= Instructions::Avx2 {
                    same_bits::<x86::Wide4>(x, y, z);
                }
                if Instructions::detect() >= Instructions::Avx512 {
                    same_bits::<x86::Wide8>(x, y, z);
                }
            }
        }

        #[test]
        fn mantissa_and_exponent_make_the_number(x in 1e-300..1e300_f64) {
            let (mantissa, exponent) = x.split();
            prop_assert!((1.0..2.0).contains(&mantissa));
            prop_assert_eq!(mantissa * exponent.power_of_two(), x);
        }
    }
}

/// Instruction sets among which the engine chooses when it runs, from the narrowest to the widest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Instructions {
    /// What every processor of the architecture has.
    Baseline,
    /// AVX2 with fused multiply-add: four lanes.
    Avx2,
    /// AVX-512: eight lanes.
    Avx512,
}

/// Environment variable that names the widest instructions to be used, as [`Instructions::name`] says them in
/// small letters; the results do not depend on it. Tests take it to enter the code of other processors.
pub const INSTRUCTIONS_VARIABLE: &str = "DRM_ENV_INSTRUCTIONS";

impl Instructions {
    /// The widest that this processor has and [`INSTRUCTIONS_VARIABLE`] lets be used; asked once.
    pub fn detect() -> Self {
        static FOUND: OnceLock<Instructions> = OnceLock::new();
        *FOUND.get_or_init(|| {
            // who started the process is told of a wrong name by `wanted`
            let most = Self::wanted().unwrap_or_default();
            Self::of_processor().min(most.unwrap_or(Self::Avx512))
        })
    }

    /// What [`INSTRUCTIONS_VARIABLE`] names, if it is set.
    ///
    /// # Errors
    /// A name that no instructions have.
    pub fn wanted() -> Result<Option<Self>, ConfigError> {
        let Some(given) = std::env::var_os(INSTRUCTIONS_VARIABLE).filter(|name| !name.is_empty())
        else {
            return Ok(None);
        };
        let given = given.to_string_lossy();
        let all = [Self::Baseline, Self::Avx2, Self::Avx512];
        let named = all
            .into_iter()
            .find(|one| one.name().to_lowercase() == *given);
        named.map(Some).ok_or_else(|| {
            let names = all.map(|one| one.name().to_lowercase()).join(", ");
            ConfigError::value(
                INSTRUCTIONS_VARIABLE,
                format!("must be one of {names}"),
                given,
            )
        })
    }

    /// The widest that this processor has.
    #[cfg(target_arch = "x86_64")]
    fn of_processor() -> Self {
        let fused = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
        let wide = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl");
        match (fused, wide) {
            (true, true) => Self::Avx512,
            (true, false) => Self::Avx2,
            (false, _) => Self::Baseline,
        }
    }

    /// The widest that this processor has.
    #[cfg(not(target_arch = "x86_64"))]
    fn of_processor() -> Self {
        Self::Baseline
    }

    /// Most environments side by side in one pack.
    pub fn lanes(self) -> usize {
        self.widths()[0]
    }

    /// Environments side by side in the packs that these instructions make fast, the most first.
    pub fn widths(self) -> &'static [usize] {
        match self {
            Self::Baseline if Narrow::WIDTH == 1 => &[1],
            Self::Baseline => &[2, 1],
            Self::Avx2 => &[4, 1],
            Self::Avx512 => &[8, 4, 1],
        }
    }

    /// Name as the processor's manual has it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::Avx2 => "AVX2",
            Self::Avx512 => "AVX-512",
        }
    }
}
