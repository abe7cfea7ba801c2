//! A low-pass filter for what a law feeds back, exact for an input that is held between samples.
//!
//! Of first order y' = w (u - y), of second order (Butterworth) y'' = w^2 (u - y) - 2^(1/2) w y', where w is the
//! cutoff. The first order turns the phase by less than 90 deg, so that a rate that is fed back through it to the
//! wheel which it is measured at takes energy out at every frequency: the feedback is positive real.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::positive;
use crate::error::ConfigError;
use crate::simd::Lane;

/// A low-pass filter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LowPass {
    /// Angular frequency where it cuts off, rad/s.
    pub cutoff: f64,
    /// Order, 1 or 2.
    pub order: u8,
}

impl Default for LowPass {
    fn default() -> Self {
        Self {
            cutoff: 10.0,
            order: 2,
        }
    }
}

/// Refuses a filter that there cannot be.
pub(super) fn validate_filter(path: &str, filter: Option<LowPass>) -> Result<(), ConfigError> {
    let Some(filter) = filter else { return Ok(()) };
    positive(&format!("{path}.cutoff"), filter.cutoff)?;
    if (1..=2).contains(&filter.order) {
        return Ok(());
    }
    Err(ConfigError::value(
        format!("{path}.order"),
        "must be 1 or 2",
        filter.order,
    ))
}

impl LowPass {
    /// What passes at a sample, `period` seconds after the last; at the first (`started` is 0) all of it.
    #[inline(always)]
    pub(super) fn pass<T: Lane>(&self, input: T, state: &mut [T; 2], started: T, period: f64) -> T {
        let [value, rate] = *state;
        let value = input.where_set(T::splat(1.0) - started, value);
        let away = value - input;
        if self.order == 1 {
            let decay = libm::exp(-self.cutoff * period);
            *state = [away.mul_add(T::splat(decay), input), rate];
            return state[0];
        }
        // damping ratio 2^(-1/2): decay and oscillation are equally fast
        let speed = self.cutoff * std::f64::consts::FRAC_1_SQRT_2;
        let decay = libm::exp(-speed * period);
        let (sin, cos) = (
            decay * libm::sin(speed * period),
            decay * libm::cos(speed * period),
        );
        let rate = rate * started;
        *state = [
            rate * (sin / speed) + away.mul_add(T::splat(cos + sin), input),
            rate * (cos - sin) - away * (2.0 * speed * sin),
        ];
        state[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Amplification of a sine, after all else has died away.
    fn gain(filter: LowPass, frequency: f64) -> f64 {
        let period = 1e-3;
        let mut state = [0.0; 2];
        let mut largest: f64 = 0.0;
        for i in 0..60_000 {
            let input = libm::sin(frequency * f64::from(i) * period);
            let started = if i == 0 { 0.0 } else { 1.0 };
            let passed = filter.pass(input, &mut state, started, period);
            if i > 40_000 {
                largest = largest.max(passed.abs());
            }
        }
        largest
    }

    /// 1 / (1 + (f / w)^(2 n))^(1/2), Butterworth's.
    #[test]
    fn filters_pass_what_butterworth_says() {
        for order in [1, 2] {
            for part in [0.3, 1.0, 3.0] {
                let filter = LowPass { cutoff: 8.0, order };
                let expected = (1.0 + f64::powi(part, 2 * i32::from(order))).sqrt().recip();
                let found = gain(filter, part * filter.cutoff);
                assert!((found - expected).abs() < 5e-3, "{order} {part}: {found}");
            }
        }
    }

    /// The step response of both orders in closed form, at samples, whatever the period.
    #[test]
    fn steps_are_exact() {
        for order in [1, 2] {
            let filter = LowPass { cutoff: 5.0, order };
            let period = 0.05;
            let mut state = [0.0; 2];
            filter.pass(0.0, &mut state, 0.0, period);
            for i in 1..=20 {
                let found = filter.pass(1.0, &mut state, 1.0, period);
                let x = filter.cutoff * period * f64::from(i);
                let y = x / f64::sqrt(2.0);
                let left = if order == 1 {
                    (-x).exp()
                } else {
                    (-y).exp() * (y.cos() + y.sin())
                };
                assert!((found - (1.0 - left)).abs() < 1e-12, "{order} {i}: {found}");
            }
        }
    }
}
