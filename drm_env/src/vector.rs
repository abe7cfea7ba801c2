//! Entering code that is compiled for the instructions of the processor at hand.

use crate::lane::{Instructions, Number, Pack};

/// Work that is compiled once for each set of instructions. `run` and all that it calls in its inner
/// loops must be inlined always, or it is compiled for none of them.
pub(crate) trait Work {
    /// What it returns.
    type Output;
    /// Does it.
    fn run(self) -> Self::Output;
}

/// A number of lanes with the instructions that its arithmetic is made of.
pub(crate) trait Vector: Number {
    /// Does the work with these instructions.
    fn enter<W: Work>(work: W) -> W::Output;
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx2,fma")]
#[inline(never)]
fn with_avx512<W: Work>(work: W) -> W::Output {
    work.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
#[inline(never)]
fn with_avx2<W: Work>(work: W) -> W::Output {
    work.run()
}

/// One environment: the widest instructions evaluate several instants side by side.
impl Vector for f64 {
    #[inline(always)]
    fn enter<W: Work>(work: W) -> W::Output {
        match Instructions::detect() {
            // SAFETY: the processor has the instructions
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx512 => unsafe { with_avx512(work) },
            // SAFETY: as above
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2 => unsafe { with_avx2(work) },
            _ => work.run(),
        }
    }
}

/// Whatever every processor has.
impl Vector for Pack<2> {
    #[inline(always)]
    fn enter<W: Work>(work: W) -> W::Output {
        work.run()
    }
}

#[cfg(target_arch = "x86_64")]
impl Vector for crate::lane::wide::Wide4 {
    #[inline(always)]
    fn enter<W: Work>(work: W) -> W::Output {
        // SAFETY: values of this type exist only where the processor has the instructions
        unsafe { with_avx2(work) }
    }
}

#[cfg(target_arch = "x86_64")]
impl Vector for crate::lane::wide::Wide8 {
    #[inline(always)]
    fn enter<W: Work>(work: W) -> W::Output {
        // SAFETY: values of this type exist only where the processor has the instructions
        unsafe { with_avx512(work) }
    }
}
