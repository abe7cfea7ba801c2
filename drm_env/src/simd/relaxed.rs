//! Fused multiplication and addition with WebAssembly's relaxed instructions, which are fused where the
//! processor's are, and nearly all are. Whoever runs such a module asks [`super::is_fused`] first.

use std::arch::wasm32::{f64x2_extract_lane, f64x2_relaxed_madd, f64x2_splat};

/// `a * b + c`, rounded once.
#[inline(always)]
pub(super) fn mul_add(a: f64, b: f64, c: f64) -> f64 {
    let (a, b, c) = (f64x2_splat(a), f64x2_splat(b), f64x2_splat(c));
    f64x2_extract_lane::<0>(f64x2_relaxed_madd(a, b, c))
}
