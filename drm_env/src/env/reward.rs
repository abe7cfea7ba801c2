//! The reward: three terms, all penalties, and the charge for an episode that ends early.

use crate::config::Task;
use crate::config::reward::RewardScale;
use crate::simd::{Laned, Number, laned};
use crate::simulation::Flight;

/// Names of the reward's terms, in the order of [`RewardSums::terms`].
pub const REWARD_NAMES: [&str; 3] = ["reward/tip_vibration", "reward/slew_error", "reward/effort"];

/// Sums over the samples of one action from which the reward's terms are made.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RewardSums<T> {
    samples: T,
    squared_vibration: T,
    squared_slew: T,
    effort: T,
}

laned!(RewardSums {
    samples,
    squared_vibration,
    squared_slew,
    effort,
});

impl<T: Number> RewardSums<T> {
    pub(crate) fn none() -> Self {
        Self::spread(&RewardSums {
            samples: 0.0,
            squared_vibration: 0.0,
            squared_slew: 0.0,
            effort: 0.0,
        })
    }

    /// Takes the sample just flown.
    #[inline(always)]
    pub(crate) fn take(&mut self, flight: &Flight<T>, scale: &RewardScale) {
        let reward = &scale.reward;
        let outputs = flight.outputs();
        let [deflection, deflection_rate] = outputs.tip;
        let error = flight.slew_error();
        let error_rate = outputs.slew[1] - flight.clock().reference.rate;
        let swing = deflection_rate * reward.vibration_time;
        let mut slide = flight.reach() * error_rate.mul_add(T::splat(reward.slew_time), error);
        if reward.with_deflection {
            slide += deflection_rate.mul_add(T::splat(reward.slew_time), deflection);
        }
        self.samples += T::splat(1.0);
        self.squared_vibration += deflection.mul_add(deflection, swing * swing);
        self.squared_slew = slide.mul_add(slide, self.squared_slew);
        self.effort += flight.effort();
    }

    /// The terms of a step of `duration` seconds, in the order of [`REWARD_NAMES`]; 0 where no sample
    /// was taken.
    #[inline(always)]
    pub(crate) fn terms(&self, scale: &RewardScale, duration: T) -> [T; 3] {
        let per_sample = self.samples.max(T::splat(1.0)).recip();
        let reward = &scale.reward;
        let vibration = scale.cost((self.squared_vibration * per_sample).sqrt());
        let slew = scale.cost((self.squared_slew * per_sample).sqrt());
        let zero = T::splat(0.0);
        [
            (-(duration * reward.tip_vibration * vibration)).where_set(self.samples, zero),
            (-(duration * reward.slew_error * slew)).where_set(self.samples, zero),
            (-(duration * reward.effort * (self.effort * per_sample)))
                .where_set(self.samples, zero),
        ]
    }
}

/// What an episode that ends at a limit of the structure is charged for the `seconds` it leaves
/// unflown, on the terms of vibration and slew error: as if the limit were held to the end, so that
/// ending early never pays.
pub(crate) fn charge_for_rest(
    task: &Task,
    scale: &RewardScale,
    reach: f64,
    seconds: f64,
) -> [f64; 2] {
    let reward = &scale.reward;
    let slide = reach * task.limits.slew_error;
    [
        -reward.tip_vibration * seconds * scale.cost(task.limits.tip_deflection),
        -reward.slew_error * seconds * scale.cost(slide),
    ]
}
