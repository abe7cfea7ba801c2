//! Metrics of an episode, computed from its states and never by a policy.

use serde::{Deserialize, Serialize};

use crate::simd::{Lane, laned};

/// Tip deflection within which the arm counts as settled, m.
pub const SETTLED_DEFLECTION: f64 = 1e-3;
/// Slew error at the tip within which the arm counts as settled, m.
pub const SETTLED_SLEW_ERROR: f64 = 1e-2;

/// Names of the metrics, in the order of [`Metrics::values`].
pub const METRIC_NAMES: [&str; 17] = [
    "tip_error_rms",
    "peak_deflection",
    "peak_slew_angle",
    "residual_rms",
    "residual_peak",
    "settling_time",
    "settled",
    "final_slew_error",
    "overshoot",
    "wheel_effort",
    "saturation",
    "slew_energy",
    "residual_energy",
    "slew_end_time",
    "duration",
    "diverged",
    "episode_return",
];

/// Metrics of one episode; SI units, angles in radians.
///
/// An episode that ends at a limit of its task has the metrics of the time up to there. One that leaves
/// the limits of [`crate::validity`] has none: `settled` is false, and all others but `slew_end_time`,
/// `duration`, `diverged` and `episode_return` are NaN, so that nobody takes them for results.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Metrics {
    /// RMS over the episode of the tip's error r e + y, m.
    pub tip_error_rms: f64,
    /// Largest |y|, m.
    pub peak_deflection: f64,
    /// Largest slew angle in the direction of the slew, rad.
    pub peak_slew_angle: f64,
    /// RMS of y from the end of the slew on, m; NaN if the episode ended before.
    pub residual_rms: f64,
    /// Largest |y| from the end of the slew on, m; NaN if the episode ended before.
    pub residual_peak: f64,
    /// Time from the end of the slew until |y| <= 1 mm and |r e| <= 10 mm hold to the end of the
    /// episode, s; NaN where that is never (censored).
    pub settling_time: f64,
    /// Whether the settling time exists.
    pub settled: bool,
    /// Slew error at the end, rad.
    pub final_slew_error: f64,
    /// Largest slew angle beyond the final reference, rad; 0 if it is not passed.
    pub overshoot: f64,
    /// Integral of the squared torque fractions of both wheels, s.
    pub wheel_effort: f64,
    /// Fraction of the time in which a wheel is at its limit.
    pub saturation: f64,
    /// Electrical energy of the slew motor, J.
    pub slew_energy: f64,
    /// Kinetic and potential energy at the end, J.
    pub residual_energy: f64,
    /// End of the slew profile, s.
    pub slew_end_time: f64,
    /// Time flown within the limits of [`crate::validity`], s.
    pub duration: f64,
    /// Whether the episode ended at a limit of the structure, beyond those of [`crate::validity`] or with
    /// numbers that are not finite.
    pub diverged: bool,
    /// Sum of the rewards; 0 where none are paid.
    pub episode_return: f64,
}

impl Metrics {
    /// Those of an episode that has left the limits of [`crate::validity`].
    pub(crate) fn of_void(self) -> Self {
        Self {
            tip_error_rms: f64::NAN,
            peak_deflection: f64::NAN,
            peak_slew_angle: f64::NAN,
            residual_rms: f64::NAN,
            residual_peak: f64::NAN,
            settling_time: f64::NAN,
            settled: false,
            final_slew_error: f64::NAN,
            overshoot: f64::NAN,
            wheel_effort: f64::NAN,
            saturation: f64::NAN,
            slew_energy: f64::NAN,
            residual_energy: f64::NAN,
            slew_end_time: self.slew_end_time,
            duration: self.duration,
            diverged: true,
            episode_return: self.episode_return,
        }
    }

    /// Values in the order of [`METRIC_NAMES`], flags as 0 or 1.
    pub fn values(&self) -> [f64; METRIC_NAMES.len()] {
        let flag = |value: bool| if value { 1.0 } else { 0.0 };
        [
            self.tip_error_rms,
            self.peak_deflection,
            self.peak_slew_angle,
            self.residual_rms,
            self.residual_peak,
            self.settling_time,
            flag(self.settled),
            self.final_slew_error,
            self.overshoot,
            self.wheel_effort,
            self.saturation,
            self.slew_energy,
            self.residual_energy,
            self.slew_end_time,
            self.duration,
            flag(self.diverged),
            self.episode_return,
        ]
    }
}

/// One sample as the accumulator takes it; flags are 0 or 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample<T> {
    /// Slew angle, rad.
    pub slew_angle: T,
    /// Slew angle minus reference, rad.
    pub slew_error: T,
    /// Reach r = L1 + a, m.
    pub reach: T,
    /// Tip deflection y, m.
    pub deflection: T,
    /// Whether the slew profile has ended.
    pub after_slew: T,
    /// Squared torque fractions of both wheels over the sample before.
    pub effort: T,
    /// Whether a wheel was at its limit over the sample before.
    pub saturated: T,
    /// Electrical power of the slew motor, W.
    pub power: T,
}

/// Running sums from which [`Metrics`] are made; its samples are one sample period apart. Counts are
/// whole numbers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Accumulator<T> {
    samples: T,
    squared_tip_error: T,
    peak_deflection: T,
    peak_slew_angle: T,
    residual_samples: T,
    squared_residual: T,
    residual_peak: T,
    /// Samples after the slew up to and including the last unsettled one.
    unsettled_until: T,
    effort: T,
    saturated: T,
    power: T,
    last_slew_error: T,
}

laned!(Accumulator {
    samples,
    squared_tip_error,
    peak_deflection,
    peak_slew_angle,
    residual_samples,
    squared_residual,
    residual_peak,
    unsettled_until,
    effort,
    saturated,
    power,
    last_slew_error,
});

impl<T: Lane> Accumulator<T> {
    /// Before the first sample; `slew_angle` is the angle at t = 0 in the direction of the slew.
    pub fn new(slew_angle: T, deflection: T) -> Self {
        let zero = T::splat(0.0);
        Self {
            samples: zero,
            squared_tip_error: zero,
            peak_deflection: deflection.abs(),
            peak_slew_angle: slew_angle,
            residual_samples: zero,
            squared_residual: zero,
            residual_peak: zero,
            unsettled_until: zero,
            effort: zero,
            saturated: zero,
            power: zero,
            last_slew_error: zero,
        }
    }

    /// Takes one sample; `direction` is the sign of the slew.
    #[inline(always)]
    pub fn take(&mut self, sample: &Sample<T>, direction: T) {
        let slew_at_tip = sample.reach * sample.slew_error;
        let tip_error = slew_at_tip + sample.deflection;
        let deflection = sample.deflection.abs();
        self.samples += T::splat(1.0);
        self.squared_tip_error = tip_error.mul_add(tip_error, self.squared_tip_error);
        self.peak_deflection = self.peak_deflection.max(deflection);
        self.peak_slew_angle = self.peak_slew_angle.max(direction * sample.slew_angle);
        let after = sample.after_slew;
        let residual = after * deflection;
        self.residual_samples += after;
        self.squared_residual = residual.mul_add(residual, self.squared_residual);
        self.residual_peak = self.residual_peak.max(residual);
        let unsettled = T::splat(SETTLED_DEFLECTION)
            .below(deflection)
            .max(T::splat(SETTLED_SLEW_ERROR).below(slew_at_tip.abs()))
            * after;
        self.unsettled_until = self
            .residual_samples
            .where_set(unsettled, self.unsettled_until);
        self.effort += sample.effort;
        self.saturated += sample.saturated;
        self.power += sample.power;
        self.last_slew_error = sample.slew_error;
    }
}

impl<T: Copy> Accumulator<T> {
    /// Sum of the slew motor's electrical power over the samples, W.
    pub(crate) fn summed_power(&self) -> T {
        self.power
    }
}

impl Accumulator<f64> {
    /// Whether a flight of so many samples can have left these sums.
    pub(crate) fn fits(&self, flown: f64) -> bool {
        let counts = [
            self.unsettled_until,
            self.residual_samples,
            self.samples,
            flown,
        ];
        let sums = [
            self.squared_tip_error,
            self.peak_deflection,
            self.squared_residual,
            self.residual_peak,
            self.unsettled_until,
            self.effort,
            self.saturated,
            self.power,
        ];
        counts.is_sorted()
            && counts.iter().all(|count| count.fract() == 0.0)
            && sums.iter().all(|sum| sum.is_finite() && *sum >= 0.0)
            && self.saturated <= self.samples
            && self.peak_slew_angle.is_finite()
            && self.last_slew_error.is_finite()
    }

    /// Metrics so far. `final_angle` is the slew's target in its own direction, rad;
    /// `residual_energy` the energy now, J.
    pub fn metrics(
        &self,
        period: f64,
        slew_end_time: f64,
        final_angle: f64,
        residual_energy: f64,
        diverged: bool,
        episode_return: f64,
    ) -> Metrics {
        let count = self.samples;
        let residuals = self.residual_samples;
        let settled = !diverged && residuals > 0.0 && self.unsettled_until < residuals;
        let root = |sum: f64, n: f64| {
            if n > 0.0 {
                libm::sqrt(sum / n)
            } else {
                f64::NAN
            }
        };
        let duration = count * period;
        // the first sample after the slew lies up to one period behind its end
        let first = duration - (residuals - 1.0) * period;
        let settling_time = if !settled {
            f64::NAN
        } else if self.unsettled_until == 0.0 {
            0.0
        } else {
            first + self.unsettled_until * period - slew_end_time
        };
        Metrics {
            tip_error_rms: root(self.squared_tip_error, count),
            peak_deflection: self.peak_deflection,
            peak_slew_angle: self.peak_slew_angle,
            residual_rms: root(self.squared_residual, residuals),
            residual_peak: if residuals > 0.0 {
                self.residual_peak
            } else {
                f64::NAN
            },
            settling_time,
            settled,
            final_slew_error: self.last_slew_error,
            overshoot: (self.peak_slew_angle - final_angle).max(0.0),
            wheel_effort: self.effort * period,
            saturation: if count > 0.0 {
                self.saturated / count
            } else {
                0.0
            },
            slew_energy: self.power * period,
            residual_energy,
            slew_end_time,
            duration,
            diverged,
            episode_return,
        }
    }
}
