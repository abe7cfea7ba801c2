//! The plan of one manoeuvre: what follows from its scenario and stays fixed through an episode.

use std::sync::Arc;

use crate::arm::PayloadProperties;
use crate::config::distribution::Setting;
use crate::config::handling::Handling;
use crate::config::mission::PlannedLeg;
use crate::config::parameter::PARAMETERS;
use crate::config::scenario::{Scenario, ValidScenario};
use crate::error::ConfigError;
use crate::hardware::delay::Delays;
use crate::hardware::reaction_wheel::Wheel;
use crate::plant::RigidInertia;
use crate::reference::shaping::ShaperKind;
use crate::reference::timeline::Timeline;

/// What is fixed through one episode.
#[derive(Debug, Clone)]
pub struct Plan {
    /// The manoeuvre.
    pub scenario: Scenario,
    /// The payload as it is.
    pub payload: PayloadProperties,
    /// The payload as reported.
    pub reported: PayloadProperties,
    /// Reference and extension.
    pub timeline: Arc<Timeline>,
    /// End of the slew profile, s.
    pub slew_end_time: f64,
    /// Least and largest extension that the equations of motion are made for, m.
    pub(crate) range: (f64, f64),
    pub(crate) root: Wheel,
    pub(crate) tip: Wheel,
    pub(crate) delays: Delays,
    /// What a leg of a mission does beside its manoeuvre.
    pub(crate) handling: Option<Arc<Handling>>,
}

/// A scenario kept in little room: as what it differs by from another one, if that tells it exactly.
#[derive(Debug, Clone)]
pub(crate) enum ScenarioDelta {
    Whole(Box<Scenario>),
    Differences(Box<[(u8, Setting)]>),
}

impl ScenarioDelta {
    /// A scenario beside a base that is kept elsewhere.
    pub(crate) fn beside(base: &Scenario, scenario: &Scenario) -> Self {
        let differences = || -> Option<Box<[(u8, Setting)]>> {
            let mut list = Vec::new();
            for (index, parameter) in PARAMETERS.iter().enumerate() {
                let setting = parameter.setting(scenario);
                if setting != parameter.setting(base) {
                    list.push((u8::try_from(index).ok()?, setting?));
                }
            }
            Some(list.into())
        };
        if let Some(list) = differences() {
            let kept = Self::Differences(list);
            if kept.scenario(base) == *scenario {
                return kept;
            }
        }
        Self::Whole(Box::new(*scenario))
    }

    /// The scenario again.
    pub(crate) fn scenario(&self, base: &Scenario) -> Scenario {
        match self {
            Self::Whole(scenario) => **scenario,
            Self::Differences(list) => {
                let mut scenario = *base;
                for (index, setting) in list {
                    // what a scenario holds can be set in another
                    let _ = PARAMETERS[usize::from(*index)].set(&mut scenario, setting);
                }
                scenario
            }
        }
    }
}

impl Plan {
    /// Plans a manoeuvre.
    ///
    /// # Errors
    /// A scenario that cannot be flown.
    pub fn new(
        scenario: impl TryInto<ValidScenario, Error: Into<ConfigError>>,
    ) -> Result<Self, ConfigError> {
        let scenario = scenario.try_into().map_err(Into::into)?;
        let deployment = &scenario.deployment;
        let range = (deployment.start, deployment.final_extension());
        Self::of_valid(&scenario, None, range)
    }

    /// Plans a leg of a mission that is flown as this scenario; the equations are made for the extensions in
    /// `range` (m).
    ///
    /// # Errors
    /// A scenario that cannot be flown.
    pub(crate) fn of_leg(
        scenario: &ValidScenario,
        leg: &PlannedLeg,
        range: (f64, f64),
    ) -> Result<Self, ConfigError> {
        Self::of_valid(scenario, Some(leg), range)
    }

    fn of_valid(
        scenario: &ValidScenario,
        leg: Option<&PlannedLeg>,
        range: (f64, f64),
    ) -> Result<Self, ConfigError> {
        let deployment_start = leg.map_or(0.0, |leg| leg.deployment_start);
        if let (Some(_), Some(stiffness)) = (leg, scenario.slew_motor.shaft_stiffness) {
            return Err(ConfigError::value(
                "slew_motor.shaft_stiffness",
                "must be null in a mission: its brakes and holds know no drive shaft",
                stiffness,
            ));
        }
        let payload = scenario.true_payload()?;
        let reported = scenario.reported()?;
        let (root, tip) = (scenario.root_wheel.wheel(), scenario.tip_wheel.wheel());
        let deployment = scenario.deployment_pieces(deployment_start)?;
        let slew = scenario.slew_pieces(&deployment)?;
        let late = [&root, &tip].map(|wheel| wheel.lag + wheel.dead_time);
        let handling = leg.and_then(|leg| leg.handling.planned(late));
        let mut timeline = Timeline::new(&slew, &deployment);
        if let Some(handling) = &handling {
            timeline = timeline.with_switches(handling.switches());
        }
        Ok(Self {
            range,
            scenario: **scenario,
            payload,
            reported,
            slew_end_time: match (scenario.slew.shaper.kind, slew.last()) {
                (ShaperKind::None, _) | (_, None) => scenario.slew.final_time(),
                (_, Some(last)) => last.start,
            },
            timeline: Arc::new(timeline),
            delays: Delays {
                root: scenario.delay_samples("root_wheel.dead_time", root.dead_time)?,
                tip: scenario.delay_samples("tip_wheel.dead_time", tip.dead_time)?,
                sensor: scenario.delay_samples("sensors.delay", scenario.sensors.delay)?,
            },
            root,
            tip,
            handling: handling.map(Arc::new),
        })
    }

    /// Sign of the slew: 1 or -1.
    pub fn direction(&self) -> f64 {
        1.0_f64.copysign(self.scenario.slew.target())
    }

    /// Open-loop torque of the slew motor, N m: rigid inverse dynamics of the reported arm, as far as the
    /// motor gives it.
    pub fn slew_torque(&self, time: f64) -> f64 {
        let reference = self.timeline.reference(time);
        RigidInertia::new(&self.scenario.arm, &self.reported)
            .with_motor(self.scenario.slew_motor.open_loop_limit)
            .slew_torque(
                &self.timeline.extension(time),
                reference.rate,
                reference.accel,
            )
    }

    /// Whether commands and outputs pass as they are.
    pub(crate) fn is_plain(&self) -> bool {
        self.delays.none() && self.scenario.sensors.are_exact()
    }

    /// Whether both wheels follow their commands at once and store any momentum.
    pub(crate) fn has_ideal_wheels(&self) -> bool {
        [&self.root, &self.tip]
            .iter()
            .all(|wheel| wheel.lag == 0.0 && wheel.momentum_limit == f64::INFINITY)
    }

    /// Integration steps in a sample that no switch cuts.
    pub(crate) fn steps_per_sample(&self) -> usize {
        steps_within(self.scenario.sample_period, self.scenario.integrator_step)
    }
}

/// Number of equal steps, none longer than `longest`, that fill a span; a remainder below a
/// millionth of a step is rounding.
pub(crate) fn steps_within(span: f64, longest: f64) -> usize {
    ((span / longest - 1e-6).ceil().max(1.0)) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::EnvConfig;
    use crate::math::rng::Seed;

    /// A drawn scenario in its differences, an override that the base does not have, and one that
    /// differs in what is no parameter.
    #[test]
    fn kept_scenarios_come_back_exactly() {
        let config = EnvConfig::default();
        let base = config.scenario;
        for seed in 0..20 {
            let drawn = config.draw(Seed::from_u64(seed), 0, &[]);
            let mut scenario = Scenario::from(drawn.expect("it can be drawn"));
            let kept = ScenarioDelta::beside(&base, &scenario);
            assert!(matches!(&kept, ScenarioDelta::Differences(list) if list.len() <= 5));
            assert_eq!(kept.scenario(&base), scenario);
            scenario.payload.length = Some(1.25);
            assert_eq!(
                ScenarioDelta::beside(&base, &scenario).scenario(&base),
                scenario
            );
            assert_eq!(
                ScenarioDelta::beside(&scenario, &base).scenario(&scenario),
                base
            );
            scenario.horizon = 7.0;
            let kept = ScenarioDelta::beside(&base, &scenario);
            assert!(matches!(kept, ScenarioDelta::Whole(_)));
            assert_eq!(kept.scenario(&base), scenario);
        }
    }
}
