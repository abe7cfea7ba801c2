//! The reward of an error, and what it can cost at most.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::simd::Number;
use crate::simd::functions::ln_1p;

/// The reward: minus a weighted sum of errors on a scale that resolves small ones, per second.
///
/// An error x (m) counts as linear x + ln(1 + x / resolution) / ln(1 + 1 m / resolution).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Reward {
    /// Weight of the tip vibration, 1/s: the amplitude of tip deflection and deflection rate times
    /// `vibration_time`.
    pub tip_vibration: f64,
    /// Weight of the slew error, 1/s: at the tip, slew error plus its rate times `slew_time`.
    pub slew_error: f64,
    /// Weight of the effort, 1/s: mean of the squared torque fractions.
    pub effort: f64,
    /// Error below which less counts for little, m.
    pub resolution: f64,
    /// Weight of the error itself beside its logarithm, 1/m; 0 is the logarithm alone.
    pub linear: f64,
    /// Time by which the deflection rate is weighed, s: one over the angular frequency of the
    /// vibration, about 4 Hz.
    pub vibration_time: f64,
    /// Time by which the slew error rate is weighed, s.
    pub slew_time: f64,
    /// Whether the slew error counts with the tip's deflection, as the error of the tip itself: what the
    /// benchmark judges. Where both wheels hold the tip, the slew angle has to lean against a deflection.
    pub with_deflection: bool,
}

impl Default for Reward {
    fn default() -> Self {
        Self {
            tip_vibration: 0.5,
            slew_error: 1.0,
            effort: 0.01,
            resolution: 1e-4,
            linear: 0.0,
            vibration_time: 0.04,
            slew_time: 2.5,
            with_deflection: false,
        }
    }
}

/// Errors beyond this count as this, m.
const LARGEST_ERROR: f64 = 1e3;

/// The reward with what follows from it once.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RewardScale {
    pub(crate) reward: Reward,
    per_resolution: f64,
    per_metre: f64,
}

impl RewardScale {
    pub(crate) fn new(reward: &Reward) -> Self {
        let per_resolution = 1.0 / reward.resolution;
        Self {
            reward: *reward,
            per_resolution,
            per_metre: 1.0 / ln_1p(per_resolution),
        }
    }

    /// The most that each term can cost, 1/s, in the order of the names of the terms.
    pub(crate) fn worst_rates(&self) -> [f64; 3] {
        let error = self.cost(LARGEST_ERROR);
        let reward = &self.reward;
        [
            reward.tip_vibration * error,
            reward.slew_error * error,
            // both wheels at their limits
            reward.effort * 2.0,
        ]
    }

    /// An error (m) on the reward's scale: 0 at none, 1 at one metre without a linear part; errors
    /// beyond a kilometre, and those that are not finite, count as one kilometre.
    #[inline(always)]
    pub(crate) fn cost<T: Number>(&self, error: T) -> T {
        let error = error.min(T::splat(LARGEST_ERROR));
        let logarithm = ln_1p(error * self.per_resolution) * self.per_metre;
        error.mul_add(T::splat(self.reward.linear), logarithm)
    }
}
