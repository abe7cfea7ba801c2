//! An action as torques over one control period.

use crate::config::Task;
use crate::config::reward::RewardScale;
use crate::env::reward::RewardSums;
use crate::env::termination::lost;
use crate::hardware::reaction_wheel::WheelTorques;
use crate::simd::mask::lanes_of;
use crate::simd::{Laned, Number};
use crate::simulation::Flight;
use crate::simulation::controller::Controller;

/// Limits actions in size and rate; `action` is the one before.
#[inline(always)]
pub(super) fn hold<T: Number>(
    action: &mut [T; 3],
    actions: &[f32],
    lanes: u32,
    task: &Task,
) -> [T; 3] {
    let change = task
        .action_rate_limit
        .map_or(f64::INFINITY, |limit| limit * task.control_period);
    let count = task.actuators.len();
    for lane in lanes_of(lanes) {
        for (held, wanted) in action.iter_mut().zip(&actions[lane * count..][..count]) {
            let before = held.lane(lane);
            let wanted = f64::from(*wanted).clamp(-1.0, 1.0);
            held.set_lane(lane, wanted.clamp(before - change, before + change));
        }
    }
    *action
}

/// The agent's torques over one control period, above the inner law's.
pub(super) struct Agent<'a, T> {
    pub(super) task: &'a Task,
    pub(super) scale: &'a RewardScale,
    pub(super) command: WheelTorques<T>,
    pub(super) slew: Option<T>,
    /// Samples to fly.
    pub(super) samples: T,
    pub(super) flown: T,
    pub(super) sums: RewardSums<T>,
    pub(super) lost: u32,
}

impl<T: Number> Controller<T> for Agent<'_, T> {
    #[inline(always)]
    fn command(&mut self, flight: &mut Flight<T>) -> (WheelTorques<T>, Option<T>) {
        let mut command = self.command;
        if let Some(law) = &self.task.inner_law {
            let below = flight.law_torques(law);
            command.root += below.root;
            command.tip += below.tip;
        }
        (command, self.slew)
    }

    #[inline(always)]
    fn flown(&mut self, flight: &mut Flight<T>) -> bool {
        let resting = flight.resting();
        let lost = lost(flight, self.task) & !resting;
        let (sums, flown) = (self.sums, self.flown);
        self.sums.take(flight, self.scale);
        self.flown += T::splat(1.0);
        let still = resting | lost;
        if still != 0 {
            for lane in lanes_of(still) {
                self.sums.put_lane(lane, &sums.lane_of(lane));
                if resting >> lane & 1 == 1 {
                    self.flown.set_lane(lane, flown.lane(lane));
                }
            }
            self.lost |= lost;
        }
        let more = self.flown.below(self.samples).bits();
        let flying = more & !resting & !lost;
        flight.rest(!flying);
        flying != 0
    }
}
