//! A reaction wheel: torque limit, stored momentum with its limit, first-order lag. Dead time is a
//! delay line of the flight, since it is counted in samples.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::non_negative;
use crate::check::positive;
use crate::error::ConfigError;
use crate::simd::{Lane, laned};

/// Parameters of one reaction wheel, whichever it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wheel {
    /// Largest torque, N m.
    pub torque_limit: f64,
    /// Largest stored angular momentum, N m s; infinite if there is no limit.
    pub momentum_limit: f64,
    /// Time constant of the first-order lag, s.
    pub lag: f64,
    /// Dead time, s.
    pub dead_time: f64,
}

/// The two wheels differ in their default torque alone.
macro_rules! wheel {
    ($name:ident, $torque:literal, $description:literal) => {
        #[doc = $description]
        #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        pub struct $name {
            /// Largest torque, N m.
            pub torque_limit: f64,
            /// Largest stored angular momentum, N m s; null stores any amount.
            pub momentum_limit: Option<f64>,
            /// Time constant of the first-order lag between command and torque, s; 0 follows at
            /// once.
            pub lag: f64,
            /// Dead time between command and torque, s, rounded to whole samples.
            pub dead_time: f64,
        }

        impl Default for $name {
            fn default() -> Self {
                Self {
                    torque_limit: $torque,
                    momentum_limit: None,
                    lag: 0.0,
                    dead_time: 0.0,
                }
            }
        }

        impl $name {
            /// The parameters as a [`Wheel`].
            pub fn wheel(&self) -> Wheel {
                Wheel {
                    torque_limit: self.torque_limit,
                    momentum_limit: self.momentum_limit.unwrap_or(f64::INFINITY),
                    lag: self.lag,
                    dead_time: self.dead_time,
                }
            }

            /// Refuses limits that are not positive and times that are negative.
            ///
            /// # Errors
            /// A limit or time constant that no wheel has, with its name.
            pub fn validate(&self) -> Result<(), ConfigError> {
                positive("torque_limit", self.torque_limit)?;
                if let Some(limit) = self.momentum_limit {
                    positive("momentum_limit", limit)?;
                }
                non_negative("lag", self.lag)?;
                non_negative("dead_time", self.dead_time)
            }
        }
    };
}

wheel!(
    RootWheel,
    100.0,
    "The reaction wheel at the shoulder: 100 N m (Table 3-1)."
);
wheel!(
    TipWheel,
    10.0,
    "The reaction wheel at the tip: 10 N m (Table 3-1)."
);

/// What changes in a wheel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WheelState<T> {
    /// Torque of the drive now, N m, before the momentum limit.
    pub torque: T,
    /// Torque on the arm now, N m.
    pub applied: T,
    /// Stored angular momentum, N m s: the negative integral of the torque on the arm.
    pub momentum: T,
}

laned!(WheelState {
    torque,
    applied,
    momentum,
});

/// Torque at the beginning, middle and end of one integration step, N m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepTorque<T> {
    /// At the beginning.
    pub start: T,
    /// In the middle.
    pub middle: T,
    /// At the end.
    pub end: T,
}

impl<T: Lane> WheelState<T> {
    /// At rest.
    pub fn rest() -> Self {
        Self {
            torque: T::splat(0.0),
            applied: T::splat(0.0),
            momentum: T::splat(0.0),
        }
    }

    /// Torque over a step of length `h` towards the held `command` (already within the torque
    /// limit). `memory` is 1 for a wheel with a lag and 0 for one that follows at once, `decay` is
    /// exp(-h / 2 lag) or 0. The torque is cut where the stored momentum would pass
    /// `momentum_limit`.
    #[inline(always)]
    pub fn step(
        &mut self,
        command: T,
        memory: T,
        decay: T,
        momentum_limit: T,
        h: T,
    ) -> StepTorque<T> {
        let begin = command + (self.torque - command) * memory;
        let middle = command + (begin - command) * decay;
        let end = command + (middle - command) * decay;
        let per_h = h.recip();
        let (high, low) = (
            (momentum_limit + self.momentum) * per_h,
            (self.momentum - momentum_limit) * per_h,
        );
        let cut = StepTorque {
            start: begin.limited(low, high),
            middle: middle.limited(low, high),
            end: end.limited(low, high),
        };
        self.torque = end;
        self.applied = cut.end;
        self.momentum -= impulse(&cut, h);
        cut
    }

    /// [`WheelState::step`] of a wheel without lag and momentum limit, to the bit.
    #[inline(always)]
    pub fn follow(&mut self, command: T, h: T) -> StepTorque<T> {
        // as `step` makes 0 of -0
        let torque = command + 0.0;
        let held = StepTorque {
            start: torque,
            middle: torque,
            end: torque,
        };
        self.torque = torque;
        self.applied = torque;
        self.momentum -= impulse(&held, h);
        held
    }
}

/// Simpson's integral of a torque over a step, N m s.
#[inline(always)]
fn impulse<T: Lane>(torque: &StepTorque<T>, h: T) -> T {
    (torque.start + torque.middle * 4.0 + torque.end) * h * (1.0 / 6.0)
}

/// Torques of the two wheels, N m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WheelTorques<T> {
    /// At the shoulder.
    pub root: T,
    /// At the tip.
    pub tip: T,
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// A wheel that follows at once by either way, bit by bit.
        #[test]
        fn ideal_wheel_is_the_limit_of_a_real_one(
            commands in proptest::collection::vec(-100.0..100.0_f64, 1..20), zero in any::<bool>(),
        ) {
            let (mut real, mut ideal) = (WheelState::rest(), WheelState::rest());
            let sign = if zero { 0.0 } else { 1.0 };
            for command in commands {
                let command = command * sign;
                let by_step = real.step(command, 0.0, 0.0, f64::INFINITY, 5e-4);
                let by_following = ideal.follow(command, 5e-4);
                for (x, y) in [
                    (by_step.start, by_following.start),
                    (by_step.middle, by_following.middle),
                    (by_step.end, by_following.end),
                    (real.torque, ideal.torque),
                    (real.applied, ideal.applied),
                    (real.momentum, ideal.momentum),
                ] {
                    prop_assert_eq!(x.to_bits(), y.to_bits());
                }
            }
        }
    }

    /// Torque and momentum of a first-order lag: T (1 - e^(-t/lag)) and its integral.
    #[test]
    fn exact_first_order_lag() {
        let (lag, h, command) = (0.05_f64, 5e-4, 40.0);
        let mut wheel = WheelState::rest();
        let decay = libm::exp(-h / 2.0 / lag);
        for _ in 0..200 {
            wheel.step(command, 1.0, decay, f64::INFINITY, h);
        }
        let grown = 1.0 - libm::exp(-0.1 / lag);
        assert!((wheel.torque - command * grown).abs() < 1e-10);
        let momentum = -command * (0.1 - lag * grown);
        assert!((wheel.momentum - momentum).abs() < 1e-8);
    }

    #[test]
    fn stored_momentum_stops_at_its_limit() {
        let mut wheel = WheelState::rest();
        for _ in 0..1000 {
            wheel.step(-10.0, 0.0, 0.0, 2.0, 2e-3);
        }
        assert!((wheel.momentum - 2.0).abs() < 1e-12);
        assert!(wheel.applied.abs() < 1e-9);
        wheel.step(10.0, 0.0, 0.0, 2.0, 2e-3);
        assert_eq!(wheel.applied, 10.0);
    }
}
