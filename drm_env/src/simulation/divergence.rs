//! When a flight is void.

use crate::simd::Number;
use crate::simulation::Flight;
use crate::validity::{LARGEST_DEFLECTION, LARGEST_SLEW_ERROR};

impl<T: Number> Flight<T> {
    /// Lanes whose state is beyond these limits or no longer finite, a bit each.
    #[inline(always)]
    pub(crate) fn void(&self) -> u32 {
        let outputs = self.outputs();
        let bent = (self.reach() * LARGEST_DEFLECTION).below(outputs.tip[0].abs());
        let astray = T::splat(LARGEST_SLEW_ERROR).below(self.slew_error().abs());
        (outputs.not_finite() + bent + astray).bits()
    }
}
