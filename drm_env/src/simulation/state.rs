//! What changes through an episode and is the same for every plant.

use crate::control::LawMemory;
use crate::hardware::reaction_wheel::WheelState;
use crate::simd::laned;
use crate::simulation::identification::Balance;
use crate::simulation::metrics::Accumulator;
use serde::{Deserialize, Serialize};

/// What changes through an episode and is the same for every manoeuvre.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct LaneState<T> {
    /// Samples flown.
    pub(crate) sample: T,
    pub(crate) root: WheelState<T>,
    pub(crate) tip: WheelState<T>,
    pub(crate) memory: LawMemory<T>,
    pub(crate) metrics: Accumulator<T>,
    /// Torques at the beginning of the last sample, N m: slew, root, tip.
    pub(crate) torques: [T; 3],
    /// What the balance of angular momentum has told so far.
    pub(crate) balance: Balance<T>,
}

laned!(LaneState {
    sample,
    root,
    tip,
    memory,
    metrics,
    torques,
    balance,
});
