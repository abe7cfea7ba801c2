//! A flight that goes on with another plan: the next leg of a mission begins where the last has ended.

use super::Flight;
use crate::control::LawMemory;
use crate::math::rng::{Purpose, Seed, Stream};
use crate::simulation::any_plant::AnyPlant;
use crate::simulation::identification::Balance;
use crate::simulation::metrics::Accumulator;
use crate::simulation::plan::Plan;
use crate::simulation::state::LaneState;

/// Angular momentum (N m s) and energy (J) that come with a payload, negative where it leaves; and what
/// brakes take that close.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct Exchange {
    /// About the shoulder, N m s.
    pub momentum: f64,
    /// Kinetic and potential, J.
    pub energy: f64,
}

impl Flight<f64> {
    /// The flight of another plan from the present state on. Angles count from the present reference on,
    /// time from now. Deflections and all rates go on as they are, also where the payload is another one
    /// (`other_payload`): it comes and goes with the velocity of the tip. Brakes that close stop the
    /// shoulder at once. Wheels, delay lines, the sensors' noise and what laws remember go on, but for what
    /// they have learnt of another payload; after a leg in which something else has held the shoulder they
    /// begin anew, and do not count the momentum that is `stored` since (N m s).
    pub(crate) fn continued(
        &self,
        plan: Plan,
        body: AnyPlant<f64>,
        other_payload: bool,
        stored: f64,
    ) -> (Self, Exchange) {
        let angle = self.clock.reference.angle;
        let told = self.scenario().reported().map_or(0.0, |p| p.mass);
        let (direction, now_told) = (plan.direction(), plan.reported.mass);
        // the noise goes on with the lines
        let unused = Stream::new(Seed::default(), 0, Purpose::Sensors);
        let mut next = Self::with_body(plan, body, unused);
        next.store(stored);
        let extension = next.clock.extension;
        let closes = next.is_braked(0) && !self.is_braked(0);
        // what holds the shoulder changes its acceleration at once
        let changes = self.is_held(0) != next.is_held(0) || self.is_braked(0) != next.is_braked(0);
        let restart = other_payload || changes;
        next.motion = next.body.turned(&self.motion, angle, restart, &extension);
        if closes {
            next.brake();
        }
        let outputs = next.outputs();
        let memory = if self.is_held(0) {
            LawMemory::fresh()
        } else if other_payload {
            self.common.memory.with_other_payload()
        } else if told != now_told && told > 0.0 && now_told > 0.0 {
            self.common.memory.with_report(told / now_told)
        } else {
            self.common.memory
        };
        next.common = LaneState {
            sample: 0.0,
            memory,
            metrics: Accumulator::new(direction * outputs.slew[0], outputs.tip[0]),
            balance: Balance::fresh(),
            ..self.common
        };
        next.effort = self.effort;
        next.manoeuvres[0]
            .lines
            .clone_from(&self.manoeuvres[0].lines);
        if let Some(lines) = &mut next.manoeuvres[0].lines {
            lines.turn(angle);
        }
        next.measured.clone_from(&self.measured);
        if let Some(measured) = &mut next.measured {
            measured[0] -= angle;
        }
        let exchange = if other_payload || closes {
            Exchange {
                momentum: next.arm_momentum() - self.arm_momentum(),
                energy: next.energy().total() - self.energy().total(),
            }
        } else {
            Exchange::default()
        };
        (next, exchange)
    }

    /// Angular momentum of arm and payload about the shoulder, N m s, without that of the wheels.
    pub fn arm_momentum(&self) -> f64 {
        let scenario = self.scenario();
        let Ok(payload) = scenario.true_payload() else {
            // it has been flown with one
            return f64::NAN;
        };
        let extension = &self.clock.extension;
        let motion = self.in_space(0);
        self.body
            .arm_momentum(&motion, extension, &scenario, &payload)
    }
}
