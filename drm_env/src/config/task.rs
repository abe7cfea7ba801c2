//! What an agent does, sees and is rewarded for: action, observation, reward, limits.

use crate::check::{non_negative, positive};
use crate::config::reward::{Reward, RewardScale};
use crate::config::scenario::Scenario;
use crate::control::Law;
use crate::error::ConfigError;
use crate::hardware::sensors::INSTRUMENTS;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// Most that an episode may pay or cost: a single-precision number holds it.
const LARGEST_RETURN: f64 = 1e30;

/// What an agent may drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Actuator {
    /// Reaction wheel at the shoulder.
    RootWheel,
    /// Reaction wheel at the tip.
    TipWheel,
    /// Slew motor; without it the open-loop law drives the slew.
    SlewMotor,
}

/// Which payload the observation shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ObservePayload {
    /// The reported one.
    #[default]
    Reported,
    /// The true one.
    True,
    /// None: the entries are zero.
    Hidden,
}

/// An instrument whose reading an observation may show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ObservedSensor {
    /// Strain gauges at the root of link 1.
    Link1Gauge,
    /// Strain gauges on link 2 where it leaves link 1.
    Link2Gauge,
    /// Accelerometer at the tip.
    TipAccelerometer,
    /// Gyro at the tip wheel.
    TipGyro,
}

/// Limits of the structure, beyond which an episode is terminated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Slew error, rad.
    pub slew_error: f64,
    /// Tip deflection, m.
    pub tip_deflection: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            slew_error: 1.5,
            tip_deflection: 1.0,
        }
    }
}

/// Action, observation and reward.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Task {
    /// Time between two actions, s: a whole number of sample periods.
    pub control_period: f64,
    /// What the action drives, in order.
    pub actuators: Vec<Actuator>,
    /// Law that runs at the sample period below the agent's torques, which are added before
    /// saturation; null is none.
    pub inner_law: Option<Law>,
    /// Torque of a wheel at an action of 1, as a multiple of the wheel's limit. Above an inner law more
    /// than 1 lets the agent overrule it; the sum is limited all the same.
    pub wheel_scale: f64,
    /// Largest change of an action per second (an action spans -1 to 1); null is unlimited.
    pub action_rate_limit: Option<f64>,
    /// Which payload is observed.
    pub observe_payload: ObservePayload,
    /// Whether the error of the reported mass is shown as the balance of angular momentum tells it
    /// while the arm slews; the slew must be open loop.
    pub observe_identified: bool,
    /// Whether the slew error taken to the tip is shown too, in metres.
    pub observe_tip_error: bool,
    /// Whether the error of the tip without the vibration is shown too: the slew error taken to the tip and what
    /// the reference's acceleration bends, of the arm with the stiffness that it is built for and the payload
    /// that the running estimate tells. The slew must be open loop.
    pub observe_still_tip_error: bool,
    /// Whether a running estimate of the error of the reported mass is shown, by the balance of angular
    /// momentum since the beginning, and by it the rate of the error at the tip without the vibration, and
    /// the torque that the payload takes beyond what the slew motor was told to give: now and at each
    /// preview time. The slew must be open loop.
    pub observe_payload_estimate: bool,
    /// Instruments whose readings are shown behind everything else, in order; they are fitted then.
    pub observe_sensors: Vec<ObservedSensor>,
    /// Number of observations stacked, the newest last.
    pub observation_history: usize,
    /// Times ahead at which the reference acceleration and the extension are shown, s.
    pub preview_times: Vec<f64>,
    /// Reward.
    pub reward: Reward,
    /// End of an episode.
    pub limits: Limits,
}

impl Default for Task {
    fn default() -> Self {
        Self {
            control_period: 0.01,
            actuators: vec![Actuator::RootWheel, Actuator::TipWheel],
            inner_law: None,
            wheel_scale: 1.0,
            action_rate_limit: None,
            observe_payload: ObservePayload::Reported,
            observe_identified: false,
            observe_tip_error: false,
            observe_still_tip_error: false,
            observe_payload_estimate: false,
            observe_sensors: Vec::new(),
            observation_history: 1,
            preview_times: vec![0.1, 0.25, 0.5, 1.0, 2.0],
            reward: Reward::default(),
            limits: Limits::default(),
        }
    }
}

impl Task {
    /// The settings of version 1 of the tasks, which were chosen by experiment so that
    /// reinforcement learning with its libraries' defaults makes steady progress.
    pub(super) fn made_for_learning(&mut self) {
        self.control_period = 0.1;
        self.observe_payload_estimate = true;
        self.observe_tip_error = true;
        self.observe_still_tip_error = true;
        self.preview_times = vec![0.1, 0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0];
        self.reward.resolution = 1e-3;
        self.reward.linear = 3.0;
        self.reward.slew_time = 0.2;
        self.reward.with_deflection = true;
    }

    /// Which instruments are observed: strain gauges of link 1 and link 2, and accelerometer.
    pub(crate) fn instruments(&self) -> [bool; INSTRUMENTS] {
        [
            ObservedSensor::Link1Gauge,
            ObservedSensor::Link2Gauge,
            ObservedSensor::TipAccelerometer,
        ]
        .map(|sensor| self.observe_sensors.contains(&sensor))
    }

    pub(super) fn validate(&self, scenario: &Scenario) -> Result<(), ConfigError> {
        positive("control_period", self.control_period)?;
        positive("sample_period", scenario.sample_period)?;
        let ratio = self.control_period / scenario.sample_period;
        if ratio < 0.5 || (ratio - libm::round(ratio)).abs() > 1e-6 * ratio {
            return Err(ConfigError::value(
                "control_period",
                format!(
                    "must be a whole number of sample periods of {} s",
                    scenario.sample_period
                ),
                self.control_period,
            ));
        }
        if self.control_period > scenario.horizon {
            return Err(ConfigError::value(
                "control_period",
                format!("must not exceed the horizon of {} s", scenario.horizon),
                self.control_period,
            ));
        }
        let repeated = |a: &Actuator| self.actuators.iter().filter(|b| *b == a).count() > 1;
        if self.actuators.is_empty() || self.actuators.iter().any(repeated) {
            return Err(ConfigError::value(
                "actuators",
                "must list root_wheel, tip_wheel and slew_motor at most once each and at least \
                 one of them",
                json!(self.actuators),
            ));
        }
        let repeated =
            |a: &ObservedSensor| self.observe_sensors.iter().filter(|b| *b == a).count() > 1;
        if self.observe_sensors.iter().any(repeated) {
            return Err(ConfigError::value(
                "observe_sensors",
                "must list link1_gauge, link2_gauge, tip_accelerometer and tip_gyro at most once \
                 each",
                json!(self.observe_sensors),
            ));
        }
        if let Some(law) = &self.inner_law {
            law.validate().map_err(|e| e.within("inner_law"))?;
        }
        positive("wheel_scale", self.wheel_scale)?;
        if let Some(limit) = self.action_rate_limit {
            positive("action_rate_limit", limit)?;
        }
        for (name, asked) in [
            ("observe_identified", self.observe_identified),
            ("observe_payload_estimate", self.observe_payload_estimate),
            ("observe_still_tip_error", self.observe_still_tip_error),
        ] {
            if asked && self.actuators.contains(&Actuator::SlewMotor) {
                return Err(ConfigError::value(
                    name,
                    "must be false where the slew motor is the agent's: the momentum it gives is not known",
                    true,
                ));
            }
        }
        if !(1..=100).contains(&self.observation_history) {
            return Err(ConfigError::value(
                "observation_history",
                "must be 1 to 100",
                self.observation_history,
            ));
        }
        for (i, &time) in self.preview_times.iter().enumerate() {
            non_negative(&format!("preview_times[{i}]"), time)?;
        }
        let Reward {
            tip_vibration,
            slew_error,
            effort,
            resolution,
            linear,
            vibration_time,
            slew_time,
            with_deflection: _,
        } = self.reward;
        for (name, value) in [
            ("tip_vibration", tip_vibration),
            ("slew_error", slew_error),
            ("effort", effort),
            ("linear", linear),
            ("vibration_time", vibration_time),
            ("slew_time", slew_time),
        ] {
            non_negative(name, value).map_err(|e| e.within("reward"))?;
        }
        positive("reward.resolution", resolution)?;
        let scale = RewardScale::new(&self.reward);
        let worst = scale.worst_rates().map(|rate| rate * scenario.horizon);
        let weights = [tip_vibration, slew_error, effort];
        let names = ["tip_vibration", "slew_error", "effort"];
        for ((name, weight), worst) in names.into_iter().zip(weights).zip(worst) {
            if worst > LARGEST_RETURN {
                let requirement = format!(
                    "must not make an episode of {} s cost more than {LARGEST_RETURN:e} (it could \
                     cost {worst:.0e})",
                    scenario.horizon
                );
                let error = ConfigError::value(name, requirement, weight);
                return Err(error.within("reward"));
            }
        }
        positive("limits.slew_error", self.limits.slew_error)?;
        positive("limits.tip_deflection", self.limits.tip_deflection)
    }
}
