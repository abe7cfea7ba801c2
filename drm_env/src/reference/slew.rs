//! The four slew acceleration profiles (thesis section 3.2) as piecewise cubics, with their exact
//! first and second integrals and final times.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::{finite, non_negative, positive};
use crate::error::ConfigError;
use crate::reference::series::Series;
use crate::reference::shaping::Shaper;

/// Family of slew acceleration profile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SlewProfile {
    /// Bang-bang acceleration; smoothed: the near-minimum-time form.
    #[default]
    MinTime,
    /// Linearly falling acceleration; smoothed: the near-minimum-energy form.
    MinEnergy,
    /// Accelerations at times that are given.
    Table,
}

/// The slew as a user states it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Slew {
    /// Angle to slew through, rad; its sign is the direction. A table turns through its own.
    pub angle: f64,
    /// Largest angular acceleration, rad/s^2. Not of a table, nor where the final time is given.
    pub max_accel: f64,
    /// Family of the profile.
    pub profile: SlewProfile,
    /// Smoothing fraction phi of the slew time: 0 (not smoothed) to below 1/4 for minimum time,
    /// below 1/2 for minimum energy.
    pub smoothing: f64,
    /// Duration, s, from which the acceleration follows (thesis section 3.2.4); null takes `max_accel`.
    pub final_time: Option<f64>,
    /// Times of a table, s, rising; at one that is given twice the acceleration jumps.
    pub times: Series,
    /// Accelerations at them, rad/s^2, with straight lines between; the arm must come to rest.
    pub accelerations: Series,
    /// What the profile is convolved with, so that it does not excite the lowest mode.
    pub shaper: Shaper,
}

impl Default for Slew {
    /// 50 deg at 0.02 rad/s^2 in minimum time (thesis section 4.2).
    fn default() -> Self {
        Self {
            angle: 50.0_f64.to_radians(),
            max_accel: 0.02,
            profile: SlewProfile::MinTime,
            smoothing: 0.0,
            final_time: None,
            times: Series::default(),
            accelerations: Series::default(),
            shaper: Shaper::default(),
        }
    }
}

/// Part of the largest rate that a table may leave at its end: more is no rounding.
const RESTING_PART: f64 = 1e-6;

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
    /// An angle, acceleration, smoothing, final time or table that no slew has, with its name.
    pub fn validate(&self) -> Result<(), ConfigError> {
        finite("angle", self.angle)?;
        positive("max_accel", self.max_accel)?;
        self.shaper.validate().map_err(|e| e.within("shaper"))?;
        if let Some(time) = self.final_time {
            positive("final_time", time)?;
        }
        let limit = match self.profile {
            SlewProfile::MinTime => 0.25,
            SlewProfile::MinEnergy => 0.5,
            SlewProfile::Table => return self.validate_table(),
        };
        self.refuse_entries()?;
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
        let (name, value) = match self.final_time {
            Some(time) if self.smoothing == 0.0 => ("final_time", time),
            _ => ("smoothing", self.smoothing),
        };
        Err(ConfigError::value(
            name,
            "must be 0 or long enough to be computed with at this angle and acceleration",
            value,
        ))
    }

    /// Refuses the entries of a table, of which this profile is none.
    pub(crate) fn refuse_entries(&self) -> Result<(), ConfigError> {
        for (name, series) in [
            ("times", &self.times),
            ("accelerations", &self.accelerations),
        ] {
            if !series.values().is_empty() {
                let requirement = "must be empty: only the profile \"table\" has any";
                return Err(ConfigError::value(name, requirement, format!("{series:?}")));
            }
        }
        Ok(())
    }

    fn validate_table(&self) -> Result<(), ConfigError> {
        let (times, accels) = (self.times.values(), self.accelerations.values());
        if let Some(time) = self.final_time {
            let requirement = "must be null: a table has its own";
            return Err(ConfigError::value("final_time", requirement, time));
        }
        if self.smoothing != 0.0 {
            let requirement = "must be 0 for a table";
            return Err(ConfigError::value("smoothing", requirement, self.smoothing));
        }
        if times.len() < 2 {
            let requirement = "must have at least 2 entries for a table";
            return Err(ConfigError::value("times", requirement, times.len()));
        }
        if times.len() != accels.len() {
            let requirement = format!("must have {} entries, one for each time", times.len());
            return Err(ConfigError::value(
                "accelerations",
                requirement,
                accels.len(),
            ));
        }
        for (i, time) in times.iter().enumerate() {
            let path = format!("times[{i}]");
            non_negative(&path, *time)?;
            if i > 0 && times[i - 1] > *time {
                let requirement = format!("must not be before the {} s ahead of it", times[i - 1]);
                return Err(ConfigError::value(path, requirement, *time));
            }
            if i > 1 && times[i - 2] == *time {
                let requirement = "must not be given more than twice";
                return Err(ConfigError::value(path, requirement, *time));
            }
            finite(&format!("accelerations[{i}]"), accels[i])?;
        }
        let pieces = self.table_pieces();
        let rates = pieces.iter().map(|piece| piece.rate.abs());
        let largest = rates.fold(0.0_f64, f64::max);
        let left = pieces.last().map_or(0.0, |piece| piece.rate);
        if left.abs() <= RESTING_PART * largest {
            return Ok(());
        }
        Err(ConfigError::value(
            "accelerations",
            format!("must bring the arm to rest (within {RESTING_PART} of the largest rate)"),
            format!("a final rate of {left} rad/s"),
        ))
    }

    /// Angle that the profile turns through, rad.
    pub fn target(&self) -> f64 {
        match self.profile {
            SlewProfile::Table => self.table_pieces().last().map_or(0.0, |piece| piece.angle),
            SlewProfile::MinTime | SlewProfile::MinEnergy => self.angle,
        }
    }

    /// Whether it turns at all: a table may come back to where it began.
    pub(crate) fn turns(&self) -> bool {
        self.profile == SlewProfile::Table || self.angle != 0.0
    }

    /// Angle over largest acceleration and square of the final time.
    fn shape(&self) -> f64 {
        let phi = self.smoothing;
        match self.profile {
            SlewProfile::MinEnergy => 1.0 / 6.0 - phi / 6.0 - phi * phi / 30.0,
            SlewProfile::MinTime | SlewProfile::Table => 0.25 - phi / 2.0 + phi * phi / 10.0,
        }
    }

    /// Exact final time of the profile before it is shaped, s: its first integral is zero and its second the angle.
    pub fn final_time(&self) -> f64 {
        match (self.profile, self.final_time) {
            (SlewProfile::Table, _) => self.times.values().last().map_or(0.0, |time| *time),
            (_, Some(time)) => time,
            _ => libm::sqrt(self.angle.abs() / (self.max_accel * self.shape())),
        }
    }

    /// Largest angular acceleration, rad/s^2: what is given, or what the final time or the table takes.
    pub fn largest_accel(&self) -> f64 {
        match (self.profile, self.final_time) {
            (SlewProfile::Table, _) => {
                let accels = self.accelerations.values().iter();
                accels.fold(0.0_f64, |largest, accel| largest.max(accel.abs()))
            }
            (_, Some(time)) => self.angle.abs() / (self.shape() * time * time),
            _ => self.max_accel,
        }
    }

    /// The pieces of a table, and behind them the state that it ends in.
    fn table_pieces(&self) -> Vec<SlewPiece> {
        let (times, accels) = (self.times.values(), self.accelerations.values());
        let mut pieces: Vec<SlewPiece> = Vec::with_capacity(times.len() + 1);
        let first = times.first().copied().unwrap_or(0.0);
        let mut next = SlewPiece {
            start: 0.0,
            accel: [0.0; 4],
            rate: 0.0,
            angle: 0.0,
        };
        if first > 0.0 {
            pieces.push(next);
            next.start = first;
        }
        for (time, accel) in times.windows(2).zip(accels.windows(2)) {
            let span = time[1] - time[0];
            if span > 0.0 {
                next.accel = [accel[0], (accel[1] - accel[0]) / span, 0.0, 0.0];
                pieces.push(next);
                let (angle, rate, _) = next.at(span);
                next = SlewPiece {
                    start: time[1],
                    accel: [0.0; 4],
                    rate,
                    angle,
                };
            }
        }
        pieces.push(next);
        pieces
    }

    /// The pieces of the profile before it is shaped, from t = 0; the last (at rest at the final angle) has no end.
    pub fn pieces(&self) -> Vec<SlewPiece> {
        let tf = self.final_time();
        if self.profile == SlewProfile::Table {
            let mut pieces = self.table_pieces();
            // at rest but for rounding
            if let Some(last) = pieces.last_mut() {
                last.rate = 0.0;
            }
            return pieces;
        }
        let ta = self.smoothing * tf;
        let w = self.largest_accel().copysign(self.angle);
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
                (SlewProfile::Table, _) => {}
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
        /// A final time gives the acceleration of which it is the final time, for all profiles.
        #[test]
        fn final_time_and_acceleration_say_the_same(
            angle in 0.01..3.0_f64, time in 0.1..100.0_f64, phi in 0.0..0.999_f64,
            energy in any::<bool>(), back in any::<bool>(),
        ) {
            let (profile, limit) = if energy {
                (SlewProfile::MinEnergy, 0.5)
            } else {
                (SlewProfile::MinTime, 0.25)
            };
            let by_time = Slew {
                angle: if back { -angle } else { angle },
                profile,
                smoothing: phi * limit,
                final_time: Some(time),
                ..Slew::default()
            };
            by_time.validate().unwrap();
            prop_assert_eq!(by_time.final_time().to_bits(), time.to_bits());
            let by_accel = Slew {
                max_accel: by_time.largest_accel(),
                final_time: None,
                ..by_time
            };
            prop_assert!((by_accel.final_time() - time).abs() < 1e-14 * time);
            // the pieces before the end reach the angle by their own integrals
            let pieces = by_time.pieces();
            let [.., last, end] = pieces.as_slice() else {
                return Err(TestCaseError::fail("a slew has pieces"));
            };
            let (reached, rate, _) = last.at(end.start - last.start);
            prop_assert!((reached - by_time.angle).abs() < 1e-12);
            prop_assert!(rate.abs() < 1e-12 * (1.0 + angle / time));
        }
    }

    /// Four straight lines: 0.03 rad/s^2 in 1 s, to the other side in 2 s, and back.
    fn table() -> Slew {
        let series = |values: &[f64]| Series::new(values).expect("they are few");
        Slew {
            profile: SlewProfile::Table,
            times: series(&[0.5, 1.5, 3.5, 4.5]),
            accelerations: series(&[0.0, 0.03, -0.03, 0.0]),
            ..Slew::default()
        }
    }

    #[test]
    fn a_table_is_integrated_exactly() {
        let slew = table();
        slew.validate().unwrap();
        assert!((slew.target() - 0.06).abs() < 1e-15, "{}", slew.target());
        assert_eq!((slew.final_time(), slew.largest_accel()), (4.5, 0.03));
        let pieces = slew.pieces();
        assert_eq!(pieces.len(), 5);
        let (angle, rate, accel) = pieces[2].at(1.0);
        assert!((angle - 0.03).abs() < 1e-15 && (rate - 0.03).abs() < 1e-15 && accel.abs() < 1e-15);
    }

    #[test]
    fn tables_survive_every_format() {
        let slew = table();
        let text = serde_json::to_string(&slew).unwrap();
        assert_eq!(serde_json::from_str::<Slew>(&text).unwrap(), slew);
        let bytes = postcard::to_allocvec(&slew).unwrap();
        assert_eq!(postcard::from_bytes::<Slew>(&bytes).unwrap(), slew);
        let many = format!("{{\"times\": {:?}}}", [0.0; 65]);
        let error = serde_json::from_str::<Slew>(&many).unwrap_err();
        assert!(error.to_string().contains("at most 64 numbers"), "{error}");
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
            let slew = Slew {
                angle,
                max_accel,
                profile,
                smoothing: phi * limit,
                ..Slew::default()
            };
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
