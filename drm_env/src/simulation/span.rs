//! A part of a sample.

/// Part of a sample that is integrated in equal steps within one piece of the timeline, in time since
/// the piece's start, s.
pub(crate) struct Span<T> {
    pub(crate) from: T,
    pub(crate) until: T,
    pub(crate) h: T,
    pub(crate) steps: usize,
}
