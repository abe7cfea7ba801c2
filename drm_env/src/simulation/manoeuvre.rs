//! What only one lane has.

use crate::config::handling::Handling;
use crate::hardware::delay::DelayLines;
use crate::reference::timeline::Timeline;
use crate::simulation::instruments::Instruments;
use crate::simulation::plan::ScenarioDelta;
use std::sync::Arc;

/// What only one lane has.
#[derive(Debug, Clone)]
pub(super) struct Manoeuvre {
    pub(super) scenario: ScenarioDelta,
    pub(super) timeline: Arc<Timeline>,
    /// Piece of the timeline in force.
    pub(super) piece: u32,
    pub(super) ideal_wheels: bool,
    /// Delay lines and noise where there are any.
    pub(super) lines: Option<Box<DelayLines>>,
    /// Gauges and accelerometer where there are any.
    pub(super) instruments: Option<Arc<Instruments>>,
    /// What a leg of a mission does beside its manoeuvre.
    pub(super) handling: Option<Arc<Handling>>,
}

impl Manoeuvre {
    /// Index of the piece in force, which is not before the present one.
    #[inline(always)]
    pub(super) fn piece_at(&self, time: f64) -> usize {
        self.timeline.index_from(self.piece as usize, time)
    }

    pub(super) fn is_still(&self) -> bool {
        self.timeline.piece(self.piece as usize).is_still()
    }
}
