//! Entering code that is compiled for the instructions of the processor at hand.
//!
//! Each kind of work names the modules in which its variants are compiled (see [`variants`]). A
//! compiler splits a crate by modules: in one of their own, the variants of one kind of work are
//! compiled beside those of another, and again only when that work has changed.

use crate::simd::{Instructions, Number, Pack};

/// Work that is compiled once for each set of instructions. `run` and all that it calls in its inner
/// loops must be inlined always, or it is compiled for none of them.
pub(crate) trait Work {
    /// What it returns.
    type Output;
    /// Where its variants are compiled: what [`variants`] has made beside it.
    type Variants: Variants;
    /// Does it.
    fn run(self) -> Self::Output;
}

/// The variants of a kind of work.
pub(crate) trait Variants {
    /// `work.run()` with AVX-512.
    ///
    /// # Safety
    /// The processor has the instructions.
    #[cfg(target_arch = "x86_64")]
    unsafe fn avx512<W: Work>(work: W) -> W::Output;
    /// `work.run()` with AVX2.
    ///
    /// # Safety
    /// The processor has the instructions.
    #[cfg(target_arch = "x86_64")]
    unsafe fn avx2<W: Work>(work: W) -> W::Output;
    /// `work.run()` with what every processor has.
    fn baseline<W: Work>(work: W) -> W::Output;
}

/// Makes a module with the type `Here`, whose variants are compiled in that module.
macro_rules! variants {
    ($module:ident) => {
        mod $module {
            use $crate::simd::dispatch::{Variants, Work};

            /// Compiles the variants in this module.
            pub(crate) struct Here;

            impl Variants for Here {
                #[cfg(target_arch = "x86_64")]
                #[inline(always)]
                unsafe fn avx512<W: Work>(work: W) -> W::Output {
                    // SAFETY: the caller's
                    unsafe { avx512::run(work) }
                }

                #[cfg(target_arch = "x86_64")]
                #[inline(always)]
                unsafe fn avx2<W: Work>(work: W) -> W::Output {
                    // SAFETY: the caller's
                    unsafe { avx2::run(work) }
                }

                #[inline(always)]
                fn baseline<W: Work>(work: W) -> W::Output {
                    baseline::run(work)
                }
            }

            #[cfg(target_arch = "x86_64")]
            mod avx512 {
                #[target_feature(enable = "avx512f,avx512dq,avx512vl,avx2,fma")]
                #[inline(never)]
                pub(super) fn run<W: $crate::simd::dispatch::Work>(work: W) -> W::Output {
                    work.run()
                }
            }

            #[cfg(target_arch = "x86_64")]
            mod avx2 {
                #[target_feature(enable = "avx2,fma")]
                #[inline(never)]
                pub(super) fn run<W: $crate::simd::dispatch::Work>(work: W) -> W::Output {
                    work.run()
                }
            }

            mod baseline {
                // not inlined, or it would stand again in each function that enters, those for wider
                // instructions included
                #[inline(never)]
                pub(super) fn run<W: $crate::simd::dispatch::Work>(work: W) -> W::Output {
                    work.run()
                }
            }
        }
    };
}
pub(crate) use variants;

/// A number of lanes with the instructions that its code is compiled for.
pub(crate) trait Vector: Number {
    /// Does the work with these instructions.
    fn enter<W: Work>(work: W) -> W::Output;
}

/// One environment: the widest instructions evaluate several instants side by side.
impl Vector for f64 {
    #[inline(always)]
    fn enter<W: Work>(work: W) -> W::Output {
        match Instructions::detect() {
            // SAFETY: the processor has the instructions
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx512 => unsafe { W::Variants::avx512(work) },
            // SAFETY: as above
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2 => unsafe { W::Variants::avx2(work) },
            _ => W::Variants::baseline(work),
        }
    }
}

/// Whatever every processor has.
impl Vector for Pack<2> {
    #[inline(always)]
    fn enter<W: Work>(work: W) -> W::Output {
        W::Variants::baseline(work)
    }
}

#[cfg(target_arch = "x86_64")]
impl Vector for crate::simd::x86::Wide4 {
    #[inline(always)]
    fn enter<W: Work>(work: W) -> W::Output {
        // SAFETY: values of this type exist only where the processor has the instructions
        unsafe { W::Variants::avx2(work) }
    }
}

#[cfg(target_arch = "x86_64")]
impl Vector for crate::simd::x86::Wide8 {
    #[inline(always)]
    fn enter<W: Work>(work: W) -> W::Output {
        // SAFETY: values of this type exist only where the processor has the instructions
        unsafe { W::Variants::avx512(work) }
    }
}
