//! Input shaping (Smith 1957; Singer and Seering 1990): the slew's acceleration is given in parts, each half a
//! period of the lowest mode after the one before, so that the vibrations which they leave cancel.
//!
//! ZV gives two parts, ZVD three, so that the vibration left is flat in the error of the frequency. The frequency is
//! the model's, for the length at that time and the payload as it is reported, and changes while the arm deploys. So the
//! spacing changes: with the phase phi of the mode, the integral of its angular frequency along the deployment, the
//! parts of what begins at phase phi come at phi + pi, and of ZVD at phi + 2 pi. It is the profile's knots (the ends
//! of its pieces) that are spaced by phase; between two knots a part is stretched evenly, so that it stays a cubic.
//! Knots are shifted such that the mean delay of all parts is the same at each of them, which keeps the final rate
//! zero; the angle, which is exact for a fixed length, is made so by a factor close to 1.

use crate::error::ConfigError;
use crate::reference::shaping::Parts;
use crate::reference::slew::SlewPiece;

/// Rounds after which the shifts of the knots no longer change.
const ROUNDS: usize = 60;
/// Change of a knot that counts as none, s.
const SAME: f64 = 1e-13;

/// The pieces of a profile, shaped. `delay` is how long after an instant (s) the mode has gone through so many half
/// periods.
///
/// # Errors
/// A profile whose knots the shaper would put out of order.
pub fn shaped(
    pieces: &[SlewPiece],
    parts: &Parts,
    delay: impl Fn(f64, usize) -> f64,
) -> Result<Vec<SlewPiece>, ConfigError> {
    let Some(last) = pieces.last() else {
        return Ok(Vec::new());
    };
    let knots: Vec<f64> = pieces.iter().map(|piece| piece.start).collect();
    let mut starts = knots.clone();
    let mut delays: Vec<Vec<f64>> = Vec::new();
    for _ in 0..ROUNDS {
        delays = starts
            .iter()
            .map(|&start| (0..parts.shares.len()).map(|i| delay(start, i)).collect())
            .collect();
        let means: Vec<f64> = delays
            .iter()
            .map(|row| row.iter().zip(&parts.shares).map(|(d, s)| d * s).sum())
            .collect();
        let longest = means.iter().copied().fold(0.0, f64::max);
        let next: Vec<f64> = knots
            .iter()
            .zip(&means)
            .map(|(t, d)| t + (longest - d))
            .collect();
        let moved = next.iter().zip(&starts).map(|(a, b)| (a - b).abs());
        let moved = moved.fold(0.0, f64::max);
        starts = next;
        if moved < SAME {
            break;
        }
    }
    // each part of each piece, on its own span
    let mut spans: Vec<(f64, f64, [f64; 4])> = Vec::new();
    for (i, share) in parts.shares.iter().enumerate() {
        for (k, piece) in pieces.iter().enumerate().take(pieces.len() - 1) {
            let (from, until) = (starts[k] + delays[k][i], starts[k + 1] + delays[k + 1][i]);
            if until <= from {
                let requirement =
                    "must be none where the lowest mode changes as fast as the profile";
                return Err(ConfigError::value("kind", requirement, parts.shares.len()));
            }
            let stretch = (knots[k + 1] - knots[k]) / (until - from);
            let mut scale = *share;
            let accel = piece.accel.map(|c| {
                let scaled = c * scale;
                scale *= stretch;
                scaled
            });
            spans.push((from, until, accel));
        }
    }
    let mut switches: Vec<f64> = spans
        .iter()
        .flat_map(|(from, until, _)| [*from, *until])
        .collect();
    switches.push(0.0);
    switches.sort_by(f64::total_cmp);
    switches
        .dedup_by(|later, earlier| *later - *earlier < crate::reference::timeline::SAME_INSTANT);
    let mut found: Vec<SlewPiece> = switches
        .windows(2)
        .map(|ends| {
            let middle = 0.5 * (ends[0] + ends[1]);
            let mut accel = [0.0; 4];
            for (from, until, c) in &spans {
                if (*from..*until).contains(&middle) {
                    let u = ends[0] - from;
                    accel[0] += c[0] + u * (c[1] + u * (c[2] + u * c[3]));
                    accel[1] += c[1] + u * (2.0 * c[2] + u * 3.0 * c[3]);
                    accel[2] += c[2] + u * 3.0 * c[3];
                    accel[3] += c[3];
                }
            }
            SlewPiece {
                start: ends[0],
                accel,
                rate: 0.0,
                angle: 0.0,
            }
        })
        .collect();
    let end = switches.last().copied().unwrap_or(0.0);
    let reached = integrated(&mut found, end);
    if reached != 0.0 {
        let factor = last.angle / reached;
        for piece in &mut found {
            piece.accel = piece.accel.map(|c| c * factor);
        }
        integrated(&mut found, end);
    }
    found.push(SlewPiece {
        start: end,
        accel: [0.0; 4],
        rate: 0.0,
        angle: last.angle,
    });
    Ok(found)
}

/// Sets rates and angles of pieces that begin at rest, and returns the angle at the end.
fn integrated(pieces: &mut [SlewPiece], end: f64) -> f64 {
    let (mut rate, mut angle) = (0.0, 0.0);
    for i in 0..pieces.len() {
        let until = pieces.get(i + 1).map_or(end, |next| next.start);
        let piece = &mut pieces[i];
        (piece.rate, piece.angle) = (rate, angle);
        (angle, rate, _) = piece.at(until - piece.start);
    }
    angle
}

/// Largest acceleration of pieces, rad/s^2.
pub fn largest_accel(pieces: &[SlewPiece]) -> f64 {
    let mut largest: f64 = 0.0;
    for pair in pieces.windows(2) {
        let span = pair[1].start - pair[0].start;
        let [_, c1, c2, c3] = pair[0].accel;
        // where the slope c1 + 2 c2 u + 3 c3 u^2 is zero
        let root = libm::sqrt((c2 * c2 - 3.0 * c3 * c1).max(0.0));
        let turns = [
            (root - c2) / (3.0 * c3),
            (-root - c2) / (3.0 * c3),
            -c1 / (2.0 * c2),
        ];
        let within = turns.into_iter().filter(|u| (0.0..=span).contains(u));
        for u in within.chain([0.0, span]) {
            largest = largest.max(pair[0].at(u).2.abs());
        }
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::shaping::{Shaper, ShaperKind};
    use crate::reference::slew::{Slew, SlewProfile};
    use proptest::prelude::*;

    /// Amplitude (of what a unit impulse leaves) that an undamped oscillator of angular frequency `w` has after the
    /// pieces: the magnitude of the integral of acceleration times e^(i w t), by Gauss's rule.
    fn left(pieces: &[SlewPiece], w: f64) -> f64 {
        let rule = crate::math::quadrature::gauss_legendre(12);
        let (mut re, mut im) = (0.0, 0.0);
        for pair in pieces.windows(2) {
            let parts = 64;
            let span = (pair[1].start - pair[0].start) / f64::from(parts);
            for i in 0..parts {
                let from = span * f64::from(i);
                let of = |trig: fn(f64) -> f64| {
                    crate::math::quadrature::integrate(&rule, from, from + span, |u| {
                        pair[0].at(u).2 * trig(w * (pair[0].start + u))
                    })
                };
                re += of(libm::cos);
                im += of(libm::sin);
            }
        }
        libm::hypot(re, im)
    }

    fn slew(profile: SlewProfile, smoothing: f64) -> Slew {
        Slew {
            profile,
            smoothing,
            ..Slew::default()
        }
    }

    /// A fixed frequency: the vibration left is that of the profile times cos(pi/2 w/w0), squared for ZVD; the
    /// time grows by half a period, or a whole one, and the angle is met.
    #[test]
    fn sensitivity_is_the_known_one() {
        let w0 = 3.1;
        let half = std::f64::consts::PI / w0;
        for (profile, smoothing) in [
            (SlewProfile::MinTime, 0.0),
            (SlewProfile::MinTime, 0.1),
            (SlewProfile::MinEnergy, 0.0),
            (SlewProfile::MinEnergy, 0.2),
        ] {
            let slew = slew(profile, smoothing);
            let plain = slew.pieces();
            for (kind, power) in [(ShaperKind::Zv, 1), (ShaperKind::Zvd, 2)] {
                let shaper = Shaper {
                    kind,
                    ..Shaper::default()
                };
                let found = shaped(&plain, &shaper.parts(), |_, i| half * i as f64).unwrap();
                let end = found.last().unwrap();
                let longer = half * f64::from(power);
                assert!((end.start - slew.final_time() - longer).abs() < 1e-12);
                assert_eq!(end.angle, slew.angle);
                let before = &found[found.len() - 2];
                let (angle, rate, _) = before.at(end.start - before.start);
                assert!((angle - slew.angle).abs() < 1e-13 && rate.abs() < 1e-14);
                assert!(largest_accel(&found) <= slew.max_accel * (1.0 + 1e-12));
                for part in [0.7, 0.9, 0.99, 1.0, 1.01, 1.1, 1.3] {
                    let w = part * w0;
                    let expected = libm::cos(std::f64::consts::FRAC_PI_2 * part)
                        .abs()
                        .powi(power);
                    let found = left(&found, w) / left(&plain, w);
                    assert!(
                        (found - expected).abs() < 1e-9,
                        "{profile:?} {kind:?} {part}: {found}"
                    );
                }
            }
        }
    }

    /// With damping, ZV leaves nothing of the damped mode: the integral of acceleration times e^(-s t) at its pole.
    #[test]
    fn damped_mode_is_left_at_rest() {
        let (w, ratio) = (2.0, 0.1);
        let shaper = Shaper {
            kind: ShaperKind::Zv,
            damping_ratio: ratio,
            ..Shaper::default()
        };
        let half = std::f64::consts::PI / (w * shaper.damped());
        let Parts { shares } = shaper.parts();
        // impulses at 0 and half a damped period
        let growth = libm::exp(ratio * w * half);
        assert!((shares[0] - shares[1] * growth).abs() < 1e-15);
        assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-15);
    }

    proptest! {
        /// A frequency that falls or rises with time: at rest at the angle, continuous, no jump of a smooth profile.
        #[test]
        fn changing_frequency_ends_at_rest(
            angle in -3.0..3.0_f64, phi in 0.01..0.2_f64, fall in -0.12..0.12_f64, three in any::<bool>(),
        ) {
            prop_assume!(angle.abs() > 0.1);
            let slew = Slew { angle, smoothing: phi, ..Slew::default() };
            let kind = if three { ShaperKind::Zvd } else { ShaperKind::Zv };
            let parts = Shaper { kind, ..Shaper::default() }.parts();
            // w = 4 e^(-fall t), whose phase is known
            let delay = |t: f64, i: usize| {
                let target = std::f64::consts::PI * i as f64;
                if fall.abs() < 1e-6 { return target / 4.0; }
                let start = libm::exp(-fall * t.min(20.0));
                -libm::log(1.0 - target * fall / (4.0 * start)) / fall
            };
            let pieces = slew.pieces();
            // else the frequency falls so fast that an impulse hardly ever comes, and its time is ill-conditioned
            prop_assume!(pieces.iter().all(|piece| delay(piece.start + 2.0, 2) < 10.0));
            let Ok(found) = shaped(&pieces, &parts, delay) else { return Ok(()) };
            let end = found.last().expect("there are pieces");
            for pair in found.windows(2) {
                let (angle_end, rate_end, accel_end) = pair[0].at(pair[1].start - pair[0].start);
                prop_assert!((angle_end - pair[1].angle).abs() < 1e-10);
                prop_assert!((rate_end - pair[1].rate).abs() < 1e-10);
                prop_assert!((accel_end - pair[1].accel[0]).abs() < 1e-10);
            }
            prop_assert_eq!(end.angle, angle);
        }
    }
}
