//! What is prescribed over a manoeuvre: the slew reference and the extension, cut into pieces within
//! which both are polynomials, so that no Runge-Kutta step straddles a switch.

use crate::reference::Extension;
use crate::reference::deployment::DeploymentPiece;
use crate::reference::slew::SlewPiece;
use crate::simd::{Lane, laned};

/// Switches closer together than this are one, s.
pub(crate) const SAME_INSTANT: f64 = 1e-9;

/// Reference and extension between two switches; every polynomial is in the time since `start`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece<T> {
    /// Start, s.
    pub start: T,
    /// Angle, rad, at the start.
    pub angle: T,
    /// Rate, rad/s, at the start.
    pub rate: T,
    /// Coefficients of the acceleration, rad/s^2 per power of a second.
    pub accel: [T; 4],
    /// Extension, m, at the start.
    pub extension: T,
    /// Extension rate, m/s, at the start.
    pub extension_rate: T,
    /// Extension acceleration, m/s^2.
    pub extension_accel: T,
}

/// The slew reference at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reference<T> {
    /// Reference angle, rad.
    pub angle: T,
    /// Reference rate, rad/s.
    pub rate: T,
    /// Reference acceleration, rad/s^2.
    pub accel: T,
}

laned!(Reference { angle, rate, accel });

laned!(Piece {
    start,
    angle,
    rate,
    accel,
    extension,
    extension_rate,
    extension_accel,
});

impl Piece<f64> {
    /// Whether the length is fixed.
    pub(crate) fn is_still(&self) -> bool {
        self.extension_rate == 0.0 && self.extension_accel == 0.0
    }
}

impl<T: Lane> Piece<T> {
    /// Reference `u` seconds after the start.
    #[inline(always)]
    pub fn reference(&self, u: T) -> Reference<T> {
        let (accel, rate) = self.motion(u);
        let [c0, c1, c2, c3] = self.accel;
        let turn = [
            self.rate,
            c0 * 0.5,
            c1 * (1.0 / 6.0),
            c2 * (1.0 / 12.0),
            c3 * 0.05,
        ];
        Reference {
            angle: u.mul_add(u.polynomial(&turn), self.angle),
            rate,
            accel,
        }
    }

    /// Reference acceleration and rate `u` seconds after the start.
    #[inline(always)]
    pub fn motion(&self, u: T) -> (T, T) {
        let [c0, c1, c2, c3] = self.accel;
        let gain = [c0, c1 * 0.5, c2 * (1.0 / 3.0), c3 * 0.25];
        (
            u.polynomial(&self.accel),
            u.mul_add(u.polynomial(&gain), self.rate),
        )
    }

    /// Extension `u` seconds after the start.
    #[inline(always)]
    pub fn extension(&self, u: T) -> Extension<T> {
        let half = self.extension_accel * 0.5;
        Extension {
            length: u.mul_add(u.mul_add(half, self.extension_rate), self.extension),
            rate: u.mul_add(self.extension_accel, self.extension_rate),
            accel: self.extension_accel,
        }
    }
}

/// The pieces of one manoeuvre; the last has no end.
#[derive(Debug, Clone, PartialEq)]
pub struct Timeline {
    pieces: Vec<Piece<f64>>,
}

impl Timeline {
    /// Merges the switches of the slew and of the deployment.
    pub fn new(slew: &[SlewPiece], deployment: &[DeploymentPiece]) -> Self {
        let mut starts: Vec<f64> = slew
            .iter()
            .map(|p| p.start)
            .chain(deployment.iter().map(|p| p.start))
            .collect();
        starts.sort_by(f64::total_cmp);
        starts.dedup_by(|later, earlier| *later - *earlier < SAME_INSTANT);
        let pieces = starts
            .into_iter()
            .map(|start| {
                let s = active(slew, start, |p| p.start);
                let d = active(deployment, start, |p| p.start);
                let u = (start - s.start).max(0.0);
                let (angle, rate, _) = s.at(u);
                let [c0, c1, c2, c3] = s.accel;
                let (extension, extension_rate, extension_accel) = d.at((start - d.start).max(0.0));
                Piece {
                    start,
                    angle,
                    rate,
                    // the cubic about the new origin
                    accel: [
                        c0 + u * (c1 + u * (c2 + u * c3)),
                        c1 + u * (2.0 * c2 + u * 3.0 * c3),
                        c2 + u * 3.0 * c3,
                        c3,
                    ],
                    extension,
                    extension_rate,
                    extension_accel,
                }
            })
            .collect();
        Self { pieces }
    }

    /// The same, cut at further instants (s), at which something else switches.
    pub(crate) fn with_switches(mut self, switches: impl Iterator<Item = f64>) -> Self {
        for start in switches {
            let index = self.index(start);
            let piece = self.pieces[index];
            let u = start - piece.start;
            if u < SAME_INSTANT {
                continue;
            }
            let (reference, extension) = (piece.reference(u), piece.extension(u));
            let [c0, c1, c2, c3] = piece.accel;
            let cut = Piece {
                start,
                angle: reference.angle,
                rate: reference.rate,
                accel: [
                    c0 + u * (c1 + u * (c2 + u * c3)),
                    c1 + u * (2.0 * c2 + u * 3.0 * c3),
                    c2 + u * 3.0 * c3,
                    c3,
                ],
                extension: extension.length,
                extension_rate: extension.rate,
                extension_accel: extension.accel,
            };
            self.pieces.insert(index + 1, cut);
        }
        self
    }

    /// Index of the piece in force at `time` (at a switch, the later one).
    pub fn index(&self, time: f64) -> usize {
        self.pieces
            .partition_point(|p| p.start <= time + SAME_INSTANT)
            .max(1)
            - 1
    }

    /// Index of the piece in force at `time`, which is not before that of the piece `hint`.
    #[inline(always)]
    pub fn index_from(&self, hint: usize, time: f64) -> usize {
        let mut index = hint;
        while time + SAME_INSTANT >= self.end(index) {
            index += 1;
        }
        index
    }

    /// Piece by index.
    #[inline(always)]
    pub fn piece(&self, index: usize) -> &Piece<f64> {
        &self.pieces[index]
    }

    /// End of a piece: where the next starts, s; infinite for the last.
    #[inline(always)]
    pub fn end(&self, index: usize) -> f64 {
        self.pieces
            .get(index + 1)
            .map_or(f64::INFINITY, |p| p.start)
    }

    /// Reference at `time` (after a switch that falls on it).
    pub fn reference(&self, time: f64) -> Reference<f64> {
        let piece = self.piece(self.index(time));
        piece.reference((time - piece.start).max(0.0))
    }

    /// Extension at `time` (after a switch that falls on it).
    pub fn extension(&self, time: f64) -> Extension<f64> {
        let piece = self.piece(self.index(time));
        piece.extension((time - piece.start).max(0.0))
    }
}

/// The piece of a list in force at `start`.
fn active<P>(pieces: &[P], start: f64, begin: impl Fn(&P) -> f64) -> &P {
    let after = pieces.partition_point(|p| begin(p) <= start + SAME_INSTANT);
    &pieces[after.max(1) - 1]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::deployment::Deployment;
    use crate::reference::slew::{Slew, SlewProfile};
    use proptest::prelude::*;

    proptest! {
        /// The merged pieces give the same reference and extension as the two lists they come from.
        #[test]
        fn merged_pieces_equal_their_sources(
            t in 0.0..25.0_f64, phi in 0.0..0.24_f64, duration in 0.5..20.0_f64,
        ) {
            let slew = Slew { smoothing: phi, profile: SlewProfile::MinTime, ..Slew::default() };
            let deployment = Deployment::default();
            let (s, d) = (slew.pieces(), deployment.pieces(duration));
            let timeline = Timeline::new(&s, &d);
            let source = active(&s, t, |p| p.start);
            let (angle, rate, accel) = source.at(t - source.start);
            let reference = timeline.reference(t);
            prop_assert!((reference.angle - angle).abs() < 1e-12);
            prop_assert!((reference.rate - rate).abs() < 1e-12);
            prop_assert!((reference.accel - accel).abs() < 1e-11);
            let cut = timeline.clone().with_switches([0.3, 7.0, t - 0.01, t].into_iter());
            prop_assert!((cut.reference(t).angle - angle).abs() < 1e-12);
            prop_assert!((cut.reference(t).rate - rate).abs() < 1e-12);
            let source = active(&d, t, |p| p.start);
            let (length, rate, _) = source.at(t - source.start);
            prop_assert!((cut.extension(t).length - length).abs() < 1e-12);
            let extension = timeline.extension(t);
            prop_assert!((extension.length - length).abs() < 1e-12);
            prop_assert!((extension.rate - rate).abs() < 1e-12);
        }
    }
}
