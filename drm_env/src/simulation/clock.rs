//! Where the manoeuvres are in their timelines.

use crate::reference::Extension;
use crate::reference::timeline::{Piece, Reference, Timeline};
use crate::simd::laned;

/// Where the manoeuvres are in their timelines. Derived from sample and plan.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Clock<T> {
    pub(super) piece: Piece<T>,
    /// Where the next piece starts, s.
    pub(super) piece_end: T,
    pub(crate) time: T,
    pub(crate) reference: Reference<T>,
    pub(crate) extension: Extension<T>,
}

laned!(Clock {
    piece,
    piece_end,
    time,
    reference,
    extension,
});

impl Clock<f64> {
    pub(super) fn new(timeline: &Timeline, index: usize, time: f64) -> Self {
        let piece = *timeline.piece(index);
        let u = (time - piece.start).max(0.0);
        Self {
            piece,
            piece_end: timeline.end(index),
            time,
            reference: piece.reference(u),
            extension: piece.extension(u),
        }
    }
}
