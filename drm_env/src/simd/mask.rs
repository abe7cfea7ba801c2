//! Sets of lanes, a bit each.

use crate::simd::Number;

/// A bit for each lane.
#[inline(always)]
pub(crate) fn everyone<T: Number>() -> u32 {
    u32::MAX >> (32 - T::WIDTH)
}

/// Indices of the bits that are set.
#[inline(always)]
pub(crate) fn lanes_of(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (bits != 0).then(|| {
            let lane = bits.trailing_zeros() as usize;
            bits &= bits - 1;
            lane
        })
    })
}
