//! The four slew acceleration profiles (thesis section 3.2) as piecewise cubics, with their exact
//! first and second integrals and final times.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::finite;
use crate::check::positive;
use crate::error::ConfigError;

/// Family of slew acceleration profile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SlewProfile {
    /// Bang-bang acceleration; smoothed: the near-minimum-time form.
    #[default]
    MinTime,
    /// Linearly falling acceleration; smoothed: the near-minimum-energy form.
    MinEnergy,
}

/// The slew as a user states it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Slew {
    /// Angle to slew through, rad; its sign is the direction.
    pub angle: f64,
    /// Largest angular acceleration, rad/s^2.
    pub max_accel: f64,
    /// Family of the profile.
    pub profile: SlewProfile,
    /// Smoothing fraction phi of the slew time: 0 (not smoothed) to below 1/4 for minimum time,
    /// below 1/2 for minimum energy.
    pub smoothing: f64,
}

impl Default for Slew {
    /// 50 deg at 0.02 rad/s^2 in minimum time (thesis section 4.2).
    fn default() -> Self {
        Self {
            angle: 50.0_f64.to_radians(),
            max_accel: 0.02,
            profile: SlewProfile::MinTime,
            smoothing: 0.0,
        }
    }
}

/// One cubic piece of the reference: acceleration `c[0] + c[1] u + c[2] u^2 + c[3] u^3`, `u` the
/// time since its start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlewPiece {
    /// Start, s.
    pub start: f64,
    /// Coefficients of the acceleration, rad/s^2 per power of a second.
    pub accel: [f64; 4],
    /// Rate at the start, rad/s.
    pub rate: f64,
    /// Angle at the start, rad.
    pub angle: f64,
}

impl SlewPiece {
    /// Angle, rate and acceleration `u` seconds after the piece's start.
    pub fn at(&self, u: f64) -> (f64, f64, f64) {
        let [c0, c1, c2, c3] = self.accel;
        let accel = c0 + u * (c1 + u * (c2 + u * c3));
        let rate = self.rate + u * (c0 + u * (c1 / 2.0 + u * (c2 / 3.0 + u * (c3 / 4.0))));
        let angle = self.angle
            + u * (self.rate + u * (c0 / 2.0 + u * (c1 / 6.0 + u * (c2 / 12.0 + u * (c3 / 20.0)))));
        (angle, rate, accel)
    }
}

impl Slew {
    /// Refuses values without a profile.
    ///
    /// # Errors
    /// An angle, acceleration or smoothing that no slew has, with its name.
    pub fn validate(&self) -> Result<(), ConfigError> {
        finite("angle", self.angle)?;
        positive("max_accel", self.max_accel)?;
        let limit = match self.profile {
            SlewProfile::MinTime => 0.25,
            SlewProfile::MinEnergy => 0.5,
        };
        if !(0.0..limit).contains(&self.smoothing) {
            return Err(ConfigError::value(
                "smoothing",
                format!("must be at least 0 and below {limit} for this profile"),
                self.smoothing,
            ));
        }
        let is_finite = |piece: &SlewPiece| {
            let SlewPiece {
                start,
                accel,
                rate,
                angle,
            } = piece;
            let numbers = [start, rate, angle].into_iter().chain(accel);
            numbers.copied().all(f64::is_finite)
        };
        if self.pieces().iter().all(is_finite) {
            return Ok(());
        }
        Err(ConfigError::value(
            "smoothing",
            "must be 0 or long enough to be computed with at this angle and acceleration",
            self.smoothing,
        ))
    }

    /// Exact final time, s: the profile's first integral is zero and its second the angle.
    pub fn final_time(&self) -> f64 {
        let phi = self.smoothing;
        let shape = match self.profile {
            SlewProfile::MinTime => 0.25 - phi / 2.0 + phi * phi / 10.0,
            SlewProfile::MinEnergy => 1.0 / 6.0 - phi / 6.0 - phi * phi / 30.0,
        };
        libm::sqrt(self.angle.abs() / (self.max_accel * shape))
    }

    /// The pieces from t = 0, the last of which (at rest at the final angle) has no end.
    pub fn pieces(&self) -> Vec<SlewPiece> {
        let tf = self.final_time();
        let ta = self.smoothing * tf;
        let w = self.max_accel.copysign(self.angle);
        // p(u) = u^2 (3 - 2 u), the smooth step of the thesis, over a duration d
        let rise = |d: f64| [0.0, 0.0, 3.0 / (d * d), -2.0 / (d * d * d)];
        let mut shapes: Vec<(f64, [f64; 4])> = Vec::with_capacity(6);
        if tf > 0.0 {
            match (self.profile, ta > 0.0) {
                (SlewProfile::MinTime, false) => {
                    shapes.push((0.0, [1.0, 0.0, 0.0, 0.0]));
                    shapes.push((tf / 2.0, [-1.0, 0.0, 0.0, 0.0]));
                }
                (SlewProfile::MinTime, true) => {
                    // by symmetry of p the switch is one cubic through tf/2
                    let [_, _, s2, s3] = rise(2.0 * ta);
                    let [_, _, r2, r3] = rise(ta);
                    shapes.push((0.0, [0.0, 0.0, r2, r3]));
                    shapes.push((ta, [1.0, 0.0, 0.0, 0.0]));
                    shapes.push((tf / 2.0 - ta, [1.0, 0.0, -2.0 * s2, -2.0 * s3]));
                    shapes.push((tf / 2.0 + ta, [-1.0, 0.0, 0.0, 0.0]));
                    shapes.push((tf - ta, [-1.0, 0.0, r2, r3]));
                }
                (SlewProfile::MinEnergy, false) => {
                    shapes.push((0.0, [1.0, -2.0 / tf, 0.0, 0.0]));
                }
                (SlewProfile::MinEnergy, true) => {
                    let [_, _, r2, r3] = rise(ta);
                    let slope = -2.0 / tf / (1.0 - 2.0 * self.smoothing);
                    shapes.push((0.0, [0.0, 0.0, r2, r3]));
                    shapes.push((ta, [1.0, slope, 0.0, 0.0]));
                    shapes.push((tf - ta, [-1.0, 0.0, r2, r3]));
                }
            }
        }
        let mut pieces: Vec<SlewPiece> = Vec::with_capacity(shapes.len() + 1);
        for (start, shape) in shapes {
            let (angle, rate) = match pieces.last() {
                Some(last) => {
                    let (angle, rate, _) = last.at(start - last.start);
                    (angle, rate)
                }
                None => (0.0, 0.0),
            };
            pieces.push(SlewPiece {
                start,
                accel: shape.map(|c| c * w),
                rate,
                angle,
            });
        }
        pieces.push(SlewPiece {
            start: tf,
            accel: [0.0; 4],
            rate: 0.0,
            angle: self.angle,
        });
        pieces
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn slew(profile: SlewProfile, smoothing: f64) -> Slew {
        Slew {
            profile,
            smoothing,
            ..Slew::default()
        }
    }

    /// Final times at 0.02 rad/s^2 and 50 deg, from the closed-form second integrals.
    #[test]
    fn closed_form_final_times() {
        let cases = [
            (0.0, 13.211091, 16.180216),
            (0.005, 13.277579, 16.220860),
            (0.01, 13.344945, 16.261893),
            (0.05, 13.917983, 16.604922),
            (0.1, 14.733661, 17.074427),
        ];
        for (phi, time, energy) in cases {
            let error = (slew(SlewProfile::MinTime, phi).final_time() - time).abs();
            assert!(error < 5e-7, "minimum time, phi {phi}: {error}");
            let error = (slew(SlewProfile::MinEnergy, phi).final_time() - energy).abs();
            assert!(error < 5e-7, "minimum energy, phi {phi}: {error}");
        }
    }

    proptest! {
        /// Every profile ends at rest at its angle, is continuous in angle and rate, and never
        /// exceeds its largest acceleration.
        #[test]
        fn integrals_close(
            angle in -3.0..3.0_f64, max_accel in 1e-3..1.0_f64, phi in 0.0..0.999_f64,
            energy in any::<bool>(),
        ) {
            let (profile, limit) = if energy {
                (SlewProfile::MinEnergy, 0.5)
            } else {
                (SlewProfile::MinTime, 0.25)
            };
            prop_assume!(angle.abs() > 1e-3);
            let slew = Slew { angle, max_accel, profile, smoothing: phi * limit };
            slew.validate().unwrap();
            let pieces = slew.pieces();
            for pair in pieces.windows(2) {
                let (angle_end, rate_end, _) = pair[0].at(pair[1].start - pair[0].start);
                prop_assert!((angle_end - pair[1].angle).abs() < 1e-10 * (1.0 + angle.abs()));
                prop_assert!((rate_end - pair[1].rate).abs() < 1e-10);
                for i in 0..=20 {
                    let u = (pair[1].start - pair[0].start) * f64::from(i) / 20.0;
                    let (_, _, accel) = pair[0].at(u);
                    prop_assert!(accel.abs() <= max_accel * (1.0 + 1e-9));
                }
            }
        }
    }
}
