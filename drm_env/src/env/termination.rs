//! When an episode ends before its horizon.

use crate::config::Task;
use crate::simd::Number;
use crate::simulation::Flight;

/// Lanes that are beyond a limit of the structure or of [`crate::validity`], a bit each.
#[inline(always)]
pub(crate) fn lost<T: Number>(flight: &Flight<T>, task: &Task) -> u32 {
    let outputs = flight.outputs();
    let slewed = T::splat(task.limits.slew_error).below(flight.slew_error().abs());
    let bent = T::splat(task.limits.tip_deflection).below(outputs.tip[0].abs());
    (slewed + bent).bits() | flight.void()
}
