//! The error of the reported mass, identified from the balance of angular momentum, and how it depends on
//! what is measured.

use crate::arm::PayloadProperties;
use crate::config::scenario::Scenario;
use crate::plant::RigidInertia;
use crate::simd::Number;

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
