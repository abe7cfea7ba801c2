//! The error of the reported mass, identified from the balance of angular momentum, and how it depends on
//! what is measured.

use crate::arm::PayloadProperties;
use crate::config::scenario::Scenario;
use crate::plant::RigidInertia;
use crate::simd::{Lane, Number, laned};
use serde::{Deserialize, Serialize};

/// Slew rate below which a payload is not identified, rad/s: a tenth of a second at 0.02 rad/s^2.
pub const SLOWEST_IDENTIFICATION: f64 = 2e-3;

/// Largest mass error that is taken for one.
pub const LARGEST_IDENTIFIED_ERROR: f64 = 0.5;

/// Moment of inertia of a payload about the shoulder below which it is none, kg m^2.
const SMALLEST_INERTIA: f64 = 1.0;

/// The error e of the reported mass: with the angular momentum h (N m s) of the arm, its measured slew rate
/// w (rad/s), and the reported moments of inertia (kg m^2) of arm and payload, I, and of the payload alone,
/// Ip, e = (h / w - I) / Ip. 0 while the arm hardly turns and without a payload.
#[inline(always)]
pub(super) fn mass_error<T: Number>(momentum: T, rate: T, reported: T, payload: T) -> T {
    let one = T::splat(1.0);
    let turning = one - rate.abs().below(T::splat(SLOWEST_IDENTIFICATION));
    let known = one - payload.below(T::splat(SMALLEST_INERTIA));
    let seen = turning * known;
    // where nothing is seen the quotient is that of ones
    let rate = rate * seen + (one - seen);
    let payload = payload * seen + (one - seen);
    let limit = T::splat(LARGEST_IDENTIFIED_ERROR);
    let error = (momentum / rate - reported) / payload * seen;
    error.limited(-limit, limit)
}

/// Weight of the report against what has been heard, rad^2/s: that of a slew at 0.02 rad/s^2 for half a second.
const TRUST_IN_THE_REPORT: f64 = 2e-5;

/// A running estimate of the error e of the reported mass, as a regression over all samples of a flight (of a
/// leg): h - I w = e Ip w, with the names of [`mass_error`]. The reference rate is the instrument: the
/// vibration in the measured rate, which has nothing to do with it, averages out in both sums. In the
/// beginning the report is believed.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct Balance<T> {
    /// Integral of w_r (h - I w) / Ip, rad^2/s.
    lacking: T,
    /// Integral of w_r w, rad^2/s.
    turned: T,
}

laned!(Balance { lacking, turned });

impl<T: Lane> Balance<T> {
    /// Nothing heard.
    pub(super) fn fresh() -> Self {
        Self {
            lacking: T::splat(0.0),
            turned: T::splat(0.0),
        }
    }

    /// Both sums.
    pub(super) fn numbers(&self) -> [T; 2] {
        [self.lacking, self.turned]
    }
}

impl<T: Number> Balance<T> {
    /// Takes a sample of so many seconds: reference rate and measured rate (rad/s), angular momentum of the arm
    /// (N m s), reported moments of inertia (kg m^2) of arm and payload and of the payload alone.
    #[inline(always)]
    pub(super) fn hear(
        &mut self,
        seconds: f64,
        rates: [T; 2],
        momentum: T,
        reported: T,
        payload: T,
    ) {
        let [reference, rate] = rates;
        let weighed = reference * seconds;
        let known = payload.max(T::splat(SMALLEST_INERTIA));
        self.lacking += weighed * ((momentum - reported * rate) / known);
        self.turned += weighed * rate;
    }

    /// The estimate, limited like what is identified at an instant; 0 without a payload to speak of.
    #[inline(always)]
    pub(super) fn error(&self, payload: T) -> T {
        let known = T::splat(1.0) - payload.below(T::splat(SMALLEST_INERTIA));
        let weight = self.turned.max(T::splat(0.0)) + TRUST_IN_THE_REPORT;
        let limit = T::splat(LARGEST_IDENTIFIED_ERROR);
        (self.lacking / weight * known).limited(-limit, limit)
    }
}

/// What an observation shows of an identification.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Identified {
    /// The identified error.
    pub error: f64,
    /// Measured slew rate, rad/s.
    pub rate: f64,
    /// Extension of link 2, m.
    pub extension: f64,
    /// What is told of the payload: mass (kg), length and width (m).
    pub payload: [f64; 3],
}

impl Identified {
    /// Derivatives of the error by the slew rate (s/rad) and by the momentum of either wheel (1 / (N m s)),
    /// whose sum is what the arm's lacks; 0 where the error is limited or nothing is identified.
    pub fn slopes(&self, scenario: &Scenario) -> [f64; 2] {
        let [mass, length, width] = self.payload;
        let payload = PayloadProperties::new(mass, length, width, scenario.payload.inertia);
        let reported = RigidInertia::new(&scenario.arm, &payload).at(self.extension);
        let payload = RigidInertia::of_payload(&scenario.arm, &payload).at(self.extension);
        let turning = self.rate.abs() >= SLOWEST_IDENTIFICATION;
        let free = self.error.abs() < LARGEST_IDENTIFIED_ERROR;
        if !(turning && free && payload >= SMALLEST_INERTIA) {
            return [0.0; 2];
        }
        // e = (h / w - I) / Ip, so that h / w = e Ip + I
        let by_momentum = -1.0 / (self.rate * payload);
        [
            self.error.mul_add(payload, reported) * by_momentum,
            by_momentum,
        ]
    }
}
