//! Logarithms, exponentials and their relatives of every lane at once.
//!
//! Nothing branches and nothing is looked up, so the time does not depend on the values, and only
//! operations of [`Lane`] are used, so a lane has the bits that a plain `f64` would have.
//!
//! The polynomials are minimax: Remez's exchange at 50 digits on the interval that the reduction
//! leaves, their coefficients then rounded to the nearest `f64`. What is minimised, and what it
//! came to, stands with each.

use std::f64::consts::{FRAC_1_SQRT_2, LN_2, LOG2_E, SQRT_2, TAU};

use crate::simd::Lane;

/// The first 42 binary digits of ln 2 (its product with an exponent is exact), and what follows.
const LN_2_HIGH: f64 = 0.693_147_180_559_890_3;
const LN_2_LOW: f64 = 5.497_923_018_708_371e-14;

/// `-(2 atanh(s) - 2 s) / s^3` in powers of `s^2`, for `s` up to `(sqrt(2) - 1) / (sqrt(2) + 1)`
/// either way; the error times `s^2` is below 2^-58.
const LOGARITHM: [f64; 7] = [
    -0.666_666_666_666_672_3,
    -0.399_999_999_994_784_4,
    -0.285_714_287_302_090_6,
    -0.222_221_996_848_982_25,
    -0.181_835_117_685_507_8,
    -0.153_152_927_128_421_35,
    -0.147_843_391_338_013_27,
];

/// `(e^r - 1 - r) / r^2` in powers of `r`, for `r` up to `ln(2) / 2` either way; the error times
/// `r` is below 2^-55.
const EXPONENTIAL: [f64; 10] = [
    0.500_000_000_000_000_6,
    0.166_666_666_666_666_85,
    0.041_666_666_666_574_97,
    0.008_333_333_333_314_742,
    0.001_388_888_893_206_002,
    0.000_198_412_699_027_556_13,
    2.480_150_474_010_21e-5,
    2.755_722_816_084_142_5e-6,
    2.762_623_420_233_172e-7,
    2.511_441_814_685_503e-8,
];

/// `(e^(2 r) - 1) / r` in powers of `r`, for `r` up to `ln(2) / 4` either way; the error of
/// `e^(2 r)` is below 2^-40 of it.
const COARSE_EXPONENTIAL: [f64; 8] = [
    1.999_999_999_966_844,
    2.000_000_000_182_746_7,
    1.333_333_349_722_089_8,
    0.666_666_632_556_454_3,
    0.266_664_607_978_796_2,
    0.088_890_597_381_027_25,
    0.025_490_667_335_796_247,
    0.006_331_522_788_549_268_4,
];

/// Taylor's series of sin(x) / x and of cos(x) in powers of x^2; for x up to pi / 4 the next terms are below
/// 1e-15.
const SINE: [f64; 8] = [
    1.0,
    -1.0 / 6.0,
    1.0 / 120.0,
    -1.0 / 5040.0,
    1.0 / 362_880.0,
    -1.0 / 39_916_800.0,
    1.0 / 6_227_020_800.0,
    -1.0 / 1_307_674_368_000.0,
];
const COSINE: [f64; 9] = [
    1.0,
    -1.0 / 2.0,
    1.0 / 24.0,
    -1.0 / 720.0,
    1.0 / 40_320.0,
    -1.0 / 3_628_800.0,
    1.0 / 479_001_600.0,
    -1.0 / 87_178_291_200.0,
    1.0 / 20_922_789_888_000.0,
];

/// 1.5 * 2^52: added to a number and taken away again it leaves the nearest whole number.
const ROUNDING: f64 = 6_755_399_441_055_744.0;

/// Argument beyond which [`exp`] keeps its value.
const EXP_LIMIT: f64 = 700.0;

/// Magnitude beyond which `tanh` is 1 to the last bit.
const TANH_LIMIT: f64 = 20.0;

/// Magnitude beyond which `sqrt(1 + x^2)` is `x` to the last bit.
const ROOT_LIMIT: f64 = 268_435_456.0;

/// The same constants in every lane.
#[inline(always)]
fn splat<T: Lane, const N: usize>(constants: &[f64; N]) -> [T; N] {
    let mut lanes = [T::splat(0.0); N];
    for (lane, constant) in lanes.iter_mut().zip(constants) {
        *lane = T::splat(*constant);
    }
    lanes
}

/// `ln((1 + excess) * 2^-halvings)` for `1 + excess` between `sqrt(1/2)` and `sqrt(2)`.
#[inline(always)]
fn ln_scaled<T: Lane>(excess: T, halvings: T) -> T {
    // ln(1 + f) = 2 atanh(s) = f - s (f - R) with s = f / (2 + f) and R = (2 atanh(s) - 2 s) / s
    let minus_s = excess / (T::splat(-2.0) - excess);
    let square = minus_s * minus_s;
    let rest = square
        .polynomial(&splat(&LOGARITHM))
        .mul_add(square, excess);
    let sum = halvings.mul_add(T::splat(-LN_2_LOW), minus_s.mul_add(rest, excess));
    halvings.mul_add(T::splat(-LN_2_HIGH), sum)
}

/// `ln(leading + trailing)`, the trailing part no larger than the last digit of the leading one,
/// which is between 2^-1022 and 2^1022.
#[inline(always)]
fn ln_of_sum<T: Lane>(leading: T, trailing: T) -> T {
    let (_, exponent) = (leading * FRAC_1_SQRT_2).split();
    let halvings = T::splat(-1.0) - exponent;
    let scale = halvings.power_of_two();
    let excess = trailing.mul_add(scale, leading.mul_add(scale, T::splat(-1.0)));
    ln_scaled(excess, halvings)
}

/// Natural logarithm of positive normal numbers, to about 1 ulp.
///
/// NaN and infinity give NaN; the result for zero, subnormal and negative numbers has no meaning.
#[inline(always)]
pub fn ln<T: Lane>(x: T) -> T {
    let (mantissa, exponent) = x.split();
    let halved = T::splat(SQRT_2).below(mantissa);
    let scale = halved.mul_add(T::splat(-0.5), T::splat(1.0));
    let excess = mantissa.mul_add(scale, T::splat(-1.0));
    // 0 x is zero unless x is not finite
    let excess = x.mul_add(T::splat(0.0), excess);
    ln_scaled(excess, -(exponent + halved))
}

/// `ln(1 + x)` for `x` above -1 and up to 1e307, to 2 ulp of the result however small it is.
///
/// Zero keeps its sign, infinity gives infinity and NaN gives NaN; the result for other numbers has
/// no meaning.
#[inline(always)]
pub fn ln_1p<T: Lane>(x: T) -> T {
    let one = T::splat(1.0);
    let (large, small) = (one.max(x), one.min(x));
    let sum = large + small;
    let lost = small - (sum - large);
    // the logarithm is never above x, and x comes through where it is not a number
    ln_of_sum(sum, lost).min(x)
}

/// Inverse hyperbolic sine up to a magnitude of 1e307, to 2 ulp of the result however small it is.
///
/// Odd to the last bit. Zero keeps its sign, infinities give themselves and NaN gives NaN; the
/// result for finite numbers above 1e307 has no meaning.
#[inline(always)]
pub fn asinh<T: Lane>(x: T) -> T {
    let magnitude = x.abs();
    // root + root_lost = sqrt(1 + y^2), the second from one step of Newton's method; 1 / root is
    // needed the less accurately the less root matters, and not at all from root = 2 on
    let y = T::splat(ROOT_LIMIT).min(magnitude);
    let squared = y.mul_add(y, T::splat(1.0));
    let squared_lost = y.mul_add(y, T::splat(1.0) - squared);
    let root = squared.sqrt();
    let half_reciprocal = root
        .mul_add(T::splat(-0.5), T::splat(1.0))
        .max(T::splat(0.0));
    let root_lost = ((-root).mul_add(root, squared) + squared_lost) * half_reciprocal;
    let root = root.max(magnitude);
    let sum = root + magnitude;
    let lost = (magnitude - (sum - root)) + root_lost;
    between(ln_of_sum(sum, lost), x)
}

/// `e^r - 1` and `2^k` where `x = r + k ln 2` and `r` is at most `ln(2) / 2` either way.
#[inline(always)]
fn exp_parts<T: Lane>(x: T) -> (T, T) {
    let whole = x.mul_add(T::splat(LOG2_E), T::splat(ROUNDING)) - ROUNDING;
    let high = whole.mul_add(T::splat(-LN_2_HIGH), x);
    let rest = whole.mul_add(T::splat(-LN_2_LOW), high);
    let excess = rest
        .polynomial(&splat(&EXPONENTIAL))
        .mul_add(rest * rest, rest);
    (excess, whole.power_of_two())
}

/// Exponential function, to about 1 ulp; arguments beyond 700 either way, infinities among them, count as
/// 700, and NaN gives NaN.
#[inline(always)]
pub fn exp<T: Lane>(x: T) -> T {
    let limited = T::splat(EXP_LIMIT).min(T::splat(-EXP_LIMIT).max(x));
    let (excess, scale) = exp_parts(limited);
    excess.mul_add(scale, scale)
}

/// Cosine and sine of angles up to 1e6 either way, to 1e-13 in absolute terms; NaN gives NaN.
#[inline(always)]
pub fn cos_sin<T: Lane>(x: T) -> (T, T) {
    let turns = x.mul_add(T::splat(1.0 / TAU), T::splat(ROUNDING)) - ROUNDING;
    let rest = turns.mul_add(T::splat(-TAU), x);
    // of a quarter, up to pi / 4, and doubled twice
    let quarter = rest * 0.25;
    let square = quarter * quarter;
    let sin = square.polynomial(&splat(&SINE)) * quarter;
    let cos = square.polynomial(&splat(&COSINE));
    let one = T::splat(1.0);
    let (sin, cos) = ((sin + sin) * cos, (sin + sin).mul_add(-sin, one));
    let (sin, cos) = ((sin + sin) * cos, (sin + sin).mul_add(-sin, one));
    (cos, sin)
}

/// Hyperbolic tangent, to 3 ulp of the result however small it is.
///
/// Odd to the last bit and never beyond 1 or beyond `x`. Zero keeps its sign, infinities give 1 or
/// -1 and NaN gives NaN.
#[inline(always)]
pub fn tanh<T: Lane>(x: T) -> T {
    let magnitude = T::splat(TANH_LIMIT).min(x.abs());
    let (excess, scale) = exp_parts(magnitude + magnitude);
    // e^2x - 1
    let grown = excess.mul_add(scale, scale - 1.0);
    between(grown / (grown + 2.0), x)
}

/// Hyperbolic tangent for single precision: to 1e-12 in absolute terms, for half the work of
/// [`tanh`].
///
/// Zero gives zero, infinities and everything beyond 20 give 1 or -1, and NaN gives NaN. Odd within
/// the error only.
#[inline(always)]
pub fn tanh_coarse<T: Lane>(x: T) -> T {
    let limited = T::splat(TANH_LIMIT).min(T::splat(-TANH_LIMIT).max(x));
    let whole = limited.mul_add(T::splat(2.0 * LOG2_E), T::splat(ROUNDING)) - ROUNDING;
    let rest = whole.mul_add(T::splat(-0.5 * LN_2), limited);
    let exponential = rest
        .polynomial(&splat(&COARSE_EXPONENTIAL))
        .mul_add(rest, T::splat(1.0));
    let below_one = T::splat(-2.0) / exponential.mul_add(whole.power_of_two(), T::splat(1.0));
    below_one + 1.0
}

/// `size` with the sign of `x`, no larger than `x`; `x` where `size` is not a number.
#[inline(always)]
fn between<T: Lane>(size: T, x: T) -> T {
    (-size).max(size.min(x))
}

#[cfg(test)]
mod tests {
    use super::*;
    #[cfg(target_arch = "x86_64")]
    use crate::simd::{Instructions, x86};
    use crate::simd::{Pack, paired};
    use proptest::prelude::*;

    /// Distance to the true value in units of its last digit.
    fn ulp(value: f64, truth: f64) -> f64 {
        if value == truth {
            return 0.0;
        }
        let size = truth.abs();
        (value - truth).abs() / (size.next_up() - size)
    }

    /// Numbers in equal steps, both ends among them.
    fn line(from: f64, to: f64) -> impl Iterator<Item = f64> {
        const STEPS: u32 = 200_000;
        (0..=STEPS).map(move |i| from + (to - from) * f64::from(i) / f64::from(STEPS))
    }

    /// Powers of ten in equal steps of their exponents.
    fn magnitudes(from: f64, to: f64) -> impl Iterator<Item = f64> {
        line(from, to).map(|exponent| libm::pow(10.0, exponent))
    }

    fn assert_close(
        name: &str,
        bound: f64,
        points: impl Iterator<Item = f64>,
        function: fn(f64) -> f64,
        truth: fn(f64) -> f64,
    ) {
        let (worst, at) = points
            .map(|x| (ulp(function(x), truth(x)), x))
            .fold((0.0, 0.0), |a, b| if b.0 > a.0 { b } else { a });
        eprintln!("{name}: {worst:.2} ulp from libm at {at:e}");
        assert!(worst <= bound, "{name}: {worst} ulp at {at:e}");
    }

    #[test]
    fn cosine_and_sine_are_those_of_libm() {
        for x in line(-100.0, 100.0).chain([0.0, 1e5, -123_456.7]) {
            let (cos, sin) = cos_sin(x);
            let error = (cos - libm::cos(x)).abs().max((sin - libm::sin(x)).abs());
            assert!(error < 1e-13 * (1.0 + x.abs() / 100.0), "{x}: {error}");
        }
        assert!(cos_sin(f64::NAN).0.is_nan());
    }

    #[test]
    fn logarithm_is_that_of_libm() {
        let points = magnitudes(-307.0, 308.0)
            .chain(line(0.5, 2.0))
            .chain([f64::MIN_POSITIVE, f64::MAX]);
        assert_close("ln", 2.0, points, ln, libm::log);
    }

    #[test]
    fn logarithm_above_one_is_that_of_libm() {
        let points = magnitudes(-320.0, 307.0)
            .chain(line(-0.999_999, 4.0))
            .chain([0.0, f64::MIN_POSITIVE]);
        assert_close("ln_1p", 3.0, points, ln_1p, libm::log1p);
    }

    #[test]
    fn inverse_hyperbolic_sine_is_that_of_libm() {
        let points = magnitudes(-320.0, 307.0).chain(line(-5.0, 5.0));
        assert_close("asinh", 4.0, points, asinh, libm::asinh);
    }

    #[test]
    fn exponential_is_that_of_libm() {
        let points = line(-700.0, 700.0).chain(line(-1.0, 1.0));
        assert_close("exp", 2.0, points, exp, libm::exp);
    }

    #[test]
    fn hyperbolic_tangent_is_that_of_libm() {
        let points = magnitudes(-320.0, 308.0)
            .chain(line(-1.0, 1.0))
            .chain(line(-25.0, 25.0));
        assert_close("tanh", 4.0, points, tanh, libm::tanh);
    }

    #[test]
    fn coarse_hyperbolic_tangent_is_within_its_error() {
        let worst = line(-25.0, 25.0)
            .chain(line(-1.0, 1.0))
            .map(|x| (tanh_coarse(x) - libm::tanh(x)).abs())
            .fold(0.0, f64::max);
        eprintln!("tanh_coarse: {worst:.1e} from libm");
        assert!(worst <= 1e-12, "{worst:e}");
        for x in [20.0, 1e300, f64::INFINITY] {
            assert_eq!((tanh_coarse(x), tanh_coarse(-x)), (1.0, -1.0));
        }
        assert_eq!((tanh_coarse(0.0), tanh_coarse(-0.0)), (0.0, 0.0));
    }

    #[test]
    fn exponential_stays_at_its_ends() {
        assert_eq!(exp(701.0), exp(700.0));
        assert_eq!(exp(f64::INFINITY), exp(700.0));
        assert_eq!(exp(-701.0), exp(-700.0));
        assert_eq!(exp(f64::NEG_INFINITY), exp(-700.0));
        assert!(exp(-700.0) > 0.0);
        assert_eq!(exp(0.0), 1.0);
    }

    #[test]
    fn what_is_not_a_number_stays_so() {
        for function in [ln, ln_1p, asinh, exp, tanh, tanh_coarse] {
            assert!(function(f64::NAN).is_nan());
            assert!(function(-f64::NAN).is_nan());
        }
        assert!(ln(f64::INFINITY).is_nan());
    }

    #[test]
    fn infinities_have_their_limits() {
        for sign in [1.0, -1.0] {
            assert_eq!(asinh(sign * f64::INFINITY), sign * f64::INFINITY);
            assert_eq!(tanh(sign * f64::INFINITY), sign);
            assert_eq!(tanh(sign * 19.5), sign);
        }
        assert_eq!(ln_1p(f64::INFINITY), f64::INFINITY);
    }

    #[test]
    fn the_smallest_numbers_are_their_own_images() {
        for x in [0.0, 5e-324, 3e-310, f64::MIN_POSITIVE, 1e-200, 1e-17] {
            for x in [x, -x] {
                assert_eq!(asinh(x).to_bits(), x.to_bits(), "asinh {x:e}");
                assert_eq!(tanh(x).to_bits(), x.to_bits(), "tanh {x:e}");
                assert_eq!(ln_1p(x).to_bits(), x.to_bits(), "ln_1p {x:e}");
            }
        }
    }

    /// Every function on a pack against the same on plain numbers, bit by bit.
    fn same_bits<T: Lane>(x: [f64; 8]) {
        let mut pack = T::splat(0.0);
        for (lane, value) in x.iter().take(T::WIDTH).enumerate() {
            pack.set_lane(lane, *value);
        }
        let results = [
            ln(pack.abs()),
            ln_1p(pack.abs()),
            asinh(pack),
            exp(pack),
            tanh(pack),
            tanh_coarse(pack),
        ];
        for (lane, x) in x.iter().take(T::WIDTH).enumerate() {
            let expected = [
                ln(x.abs()),
                ln_1p(x.abs()),
                asinh(*x),
                exp(*x),
                tanh(*x),
                tanh_coarse(*x),
            ];
            for (i, (result, expected)) in results.iter().zip(expected).enumerate() {
                let result = result.lane(lane);
                let same = result.to_bits() == expected.to_bits()
                    || (result.is_nan() && expected.is_nan());
                assert!(same, "function {i} of {x:e}: {result:e}, {expected:e}");
            }
        }
    }

    fn same_bits_in_every_lane_type(x: [f64; 8]) {
        same_bits::<Pack<2>>(x);
        same_bits::<Pack<8>>(x);
        same_bits::<paired::Paired<Pack<4>>>(x);
        #[cfg(target_arch = "x86_64")]
        {
            if Instructions::detect() >= Instructions::Avx2 {
                same_bits::<x86::Wide4>(x);
            }
            if Instructions::detect() >= Instructions::Avx512 {
                same_bits::<x86::Wide8>(x);
            }
        }
    }

    #[test]
    fn packs_compute_the_bits_of_plain_numbers_at_the_edges() {
        let (tiny, huge) = (f64::MIN_POSITIVE, 1e307);
        same_bits_in_every_lane_type([0.0, -0.0, 1.0, -1.0, tiny, -tiny, huge, -huge]);
        let inf = f64::INFINITY;
        same_bits_in_every_lane_type([inf, -inf, f64::NAN, 5e-324, -5e-324, 700.0, -701.0, 20.0]);
    }

    proptest! {
        #[test]
        fn packs_compute_the_bits_of_plain_numbers(
            mantissas in proptest::array::uniform8(1.0..2.0_f64),
            exponents in proptest::array::uniform8(-60..60_i32),
            signs in proptest::array::uniform8(any::<bool>()),
        ) {
            same_bits_in_every_lane_type(std::array::from_fn(|i| {
                let size = libm::ldexp(mantissas[i], exponents[i]);
                if signs[i] { -size } else { size }
            }));
        }

        #[test]
        fn functions_are_those_of_libm_anywhere(
            mantissa in 1.0..2.0_f64,
            exponent in -1022..1019_i32,
            argument in -700.0..700.0_f64,
        ) {
            let x = libm::ldexp(mantissa, exponent);
            prop_assert!(ulp(ln(x), libm::log(x)) <= 2.0);
            prop_assert!(ulp(ln_1p(x), libm::log1p(x)) <= 3.0);
            prop_assert!(ulp(asinh(x), libm::asinh(x)) <= 4.0);
            prop_assert!(ulp(tanh(x), libm::tanh(x)) <= 4.0);
            prop_assert!(ulp(exp(argument), libm::exp(argument)) <= 2.0);
        }

        #[test]
        fn odd_functions_are_odd_to_the_last_bit(mantissa in 1.0..2.0_f64, exponent in -1022..1019_i32) {
            let x = libm::ldexp(mantissa, exponent);
            prop_assert_eq!(asinh(-x).to_bits(), (-asinh(x)).to_bits());
            prop_assert_eq!(tanh(-x).to_bits(), (-tanh(x)).to_bits());
            prop_assert!(tanh(x) <= 1.0 && tanh(x) <= x && asinh(x) <= x);
        }
    }
}
