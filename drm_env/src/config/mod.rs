//! Configuration of an environment: a scenario, what is drawn for each episode, and the task.
//! Presets give the registered environments their defaults.

pub mod distribution;
pub mod handling;
pub(crate) mod json;
pub mod mission;
pub mod options;
pub mod parameter;
pub(crate) mod reward;
pub mod scenario;
mod shaped_slew;
pub mod task;
mod valid;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::config::distribution::Distribution;
use crate::config::mission::{Mission, ValidMission};
use crate::config::options::{apply_option, overlay, release_fixed};
use crate::config::parameter::{COUNT, Overrides, PARAMETERS, Randomize};
use crate::config::scenario::{Scenario, ValidScenario};
use crate::control::{Law, ServoLaw};
use crate::error::ConfigError;
use crate::hardware::sensors::Sensors;
use crate::math::rng::{Purpose, Seed, Stream};
use crate::plant::PlantModel;

pub use json::{law_from_json, mission_from_json, scenario_from_json, typed};
use json::{name_law, object};
pub use reward::Reward;
pub use task::{Actuator, Limits, ObservePayload, ObservedSensor, Task};
pub use valid::ValidConfig;

/// Everything that defines an environment. The default is `drm_env/Slew-v0`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct EnvConfig {
    /// The manoeuvre, as far as it is not drawn.
    pub scenario: Scenario,
    /// What is drawn for each episode.
    pub randomize: Randomize,
    /// Action, observation and reward.
    pub task: Task,
    /// Legs of which an episode is made; null is one manoeuvre, the scenario's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mission: Option<Mission>,
}

impl Default for EnvConfig {
    fn default() -> Self {
        let mut config = Self::fixed();
        config.randomize.payload_mass = Some(crate::config::distribution::Distribution::Uniform([
            50.0, 500.0,
        ]));
        config.randomize.mass_error = Some(crate::config::distribution::Distribution::Uniform([
            -0.15, 0.15,
        ]));
        config
    }
}

/// Names of the presets, one a registered environment.
pub const PRESETS: [&str; 8] = [
    "slew",
    "slew_residual",
    "slew_thesis",
    "slew_direct",
    "slew_v1",
    "slew_residual_v1",
    "slew_flexible",
    "mission",
];

/// Duration of an episode of the default mission, s: a little more than its legs can take.
const MISSION_HORIZON: f64 = 120.0;

/// Draws with which a configuration is tried, and attempts after which overrides are refused.
const TRIALS: u64 = 64;

/// So many of the [`TRIALS`] must be flyable: then that an episode cannot be drawn within
/// [`MOST_ATTEMPTS`] is out of the question.
const FEWEST_FLYABLE: usize = 8;

/// Attempts at drawing parameters that go together.
const MOST_ATTEMPTS: u64 = 1000;

impl EnvConfig {
    fn fixed() -> Self {
        Self {
            scenario: Scenario::default(),
            randomize: Randomize::default(),
            task: Task::default(),
            mission: None,
        }
    }

    /// What the arm is believed to be where an agent is shown what it bends: by the law below it, if that has a
    /// model, else as it was built, whatever is drawn of it.
    pub(crate) fn believed(&self) -> ServoLaw {
        let [link1, link2] = [&self.scenario.arm.link1, &self.scenario.arm.link2];
        self.task
            .inner_law
            .as_ref()
            .and_then(Law::needs_model)
            .copied()
            .unwrap_or_else(|| ServoLaw {
                bending_stiffness: [link1.bending_stiffness, link2.bending_stiffness],
                ..ServoLaw::default()
            })
    }

    /// The defaults of a registered environment.
    ///
    /// # Errors
    /// A name that no task has.
    pub fn preset(name: &str) -> Result<Self, ConfigError> {
        let mut config = Self::default();
        match name {
            "slew" => {}
            "slew_residual" => {
                config.task.control_period = 0.02;
                config.task.inner_law = Some(Law::named("linear")?);
            }
            "slew_thesis" => {
                config = Self::fixed();
                config.task.control_period = 0.002;
            }
            "slew_direct" => config.task.actuators.push(Actuator::SlewMotor),
            "slew_v1" => config.task.made_for_learning(),
            "slew_residual_v1" => {
                config.task.made_for_learning();
                config.task.inner_law = Some(Law::named("linear")?);
            }
            "slew_flexible" => {
                config.task.made_for_learning();
                config.task.control_period = 0.02;
                config.make_flexible();
            }
            "mission" => {
                config.task.made_for_learning();
                config.mission = Some(Mission::default());
                config.scenario.horizon = MISSION_HORIZON;
            }
            other => {
                return Err(ConfigError::value(
                    "task",
                    format!("must be one of {}", PRESETS.join(", ")),
                    other,
                ));
            }
        }
        Ok(config)
    }

    /// The arm that one could build: slope-continuous links that are damped like a structure, wheels that lag and
    /// fill up, sensors with errors, a payload grappled beside the axis; stiffness and damping are known
    /// roughly.
    fn make_flexible(&mut self) {
        let scenario = &mut self.scenario;
        scenario.plant = PlantModel::Consistent;
        scenario.dynamics.damping_ratio = 0.005;
        scenario.root_wheel.lag = 0.005;
        scenario.tip_wheel.lag = 0.005;
        // what the suite of this environment needs under the servo
        scenario.root_wheel.momentum_limit = Some(1200.0);
        scenario.tip_wheel.momentum_limit = Some(130.0);
        // about what good encoders, gyroscopes and strain gauges give
        scenario.sensors = Sensors {
            angle_noise: 1e-5,
            rate_noise: 1e-4,
            deflection_noise: 1e-4,
            deflection_rate_noise: 1e-3,
            angle_resolution: 6e-6,
            tip_rate_noise: 1e-4,
            delay: 0.002,
            ..Sensors::default()
        };
        let around = |value: f64, part: f64| {
            Some(Distribution::Uniform([
                value * (1.0 - part),
                value * (1.0 + part),
            ]))
        };
        let arm = &scenario.arm;
        let drawn = &mut self.randomize;
        drawn.payload_offset = Some(Distribution::Uniform([-0.05, 0.05]));
        drawn.link1_bending_stiffness = around(arm.link1.bending_stiffness, 0.1);
        drawn.link2_bending_stiffness = around(arm.link2.bending_stiffness, 0.1);
        drawn.damping_ratio = around(scenario.dynamics.damping_ratio, 0.5);
    }

    /// A preset, overlaid with parts of a configuration and then with flat options; validated.
    ///
    /// # Errors
    /// Malformed text, unknown names, values of the wrong type or out of range; each with its path.
    pub fn resolve(
        preset: &str,
        config: Option<&str>,
        options: Option<&str>,
    ) -> Result<Self, ConfigError> {
        let base = Self::preset(preset)?;
        let mut document =
            serde_json::to_value(&base).map_err(|e| ConfigError::form("configuration", e))?;
        if let Some(text) = config {
            let parts = object("config", text)?;
            if is_whole(&parts, &document) {
                // a whole configuration that says nothing of a mission has none
                document["mission"] = Value::Null;
            }
            release_fixed(&mut document, &parts);
            overlay(&mut document, parts);
        }
        if let Some(text) = options {
            for (name, value) in object("options", text)? {
                apply_option(&mut document, &name, value)?;
            }
        }
        Self::from_value(document)
    }

    /// A whole configuration from JSON text; parts left out have the defaults of [`EnvConfig`].
    ///
    /// # Errors
    /// Text that is no JSON, an unknown field, a value that the configuration cannot have; with its path.
    pub fn from_json(text: &str) -> Result<Self, ConfigError> {
        Self::resolve(PRESETS[0], Some(text), None)
    }

    fn from_value(mut document: Value) -> Result<Self, ConfigError> {
        if let Some(law) = document.pointer_mut("/task/inner_law") {
            name_law(law);
        }
        let config: Self = typed(&document)?;
        config.validate()?;
        Ok(config)
    }

    /// JSON text with every field.
    pub fn to_json(&self) -> String {
        // a struct of numbers, strings and lists always serialises
        serde_json::to_string(self).unwrap_or_default()
    }

    /// Refuses what cannot be flown: drawn parameters whose ends fit no choice of the others, and ranges
    /// that seldom go together.
    ///
    /// # Errors
    /// The first value that cannot be flown or judged, with its path.
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.task.validate(&self.scenario)?;
        if let Some(mission) = &self.mission {
            mission.check_control_period(self.task.control_period)?;
        }
        let drawn = self.randomize.distributions();
        let (mut lowest, mut highest) = (self.scenario, self.scenario);
        for (parameter, distribution) in PARAMETERS.iter().zip(&drawn) {
            let Some(distribution) = distribution else {
                continue;
            };
            let path = format!("randomize.{}", parameter.name);
            distribution.validate().map_err(|e| e.within(&path))?;
            let extremes = distribution.extremes();
            if let (Some(first), Some(last)) = (extremes.first(), extremes.last()) {
                parameter.set(&mut lowest, first)?;
                parameter.set(&mut highest, last)?;
            }
        }
        if !self.draws() {
            return self.check(&lowest);
        }
        let trials: Vec<_> = (0..TRIALS)
            .map(|episode| self.attempt(Seed::default(), episode, 0, &[]))
            .collect();
        let flyable = trials.iter().filter_map(|trial| trial.as_ref().ok());
        // an end is tried beside these
        let others: Vec<Scenario> = [&lowest, &highest]
            .into_iter()
            .filter(|ends| self.check(ends).is_ok())
            .chain(flyable.clone().map(|trial| &**trial))
            .copied()
            .collect();
        if others.is_empty() {
            return self.check(&lowest);
        }
        for (parameter, distribution) in PARAMETERS.iter().zip(&drawn) {
            for extreme in distribution.iter().flat_map(|d| d.extremes()) {
                let mut first = None;
                for mut scenario in others.iter().copied() {
                    parameter.set(&mut scenario, &extreme)?;
                    match self.check(&scenario) {
                        Ok(()) => {
                            first = None;
                            break;
                        }
                        Err(error) => first = first.or(Some(error)),
                    }
                }
                if let Some(error) = first {
                    return Err(error);
                }
            }
        }
        let count = flyable.count();
        let failure = trials.into_iter().find_map(Result::err);
        match failure {
            Some(error) if count < FEWEST_FLYABLE => Err(ConfigError::form(
                "randomize",
                format!(
                    "only {count} of {TRIALS} draws can be flown, at least {FEWEST_FLYABLE} must: \
                     draw what goes together ({error})"
                ),
            )),
            _ => Ok(()),
        }
    }

    /// Refuses a scenario that cannot be flown, alone or in the mission.
    fn check(&self, scenario: &Scenario) -> Result<(), ConfigError> {
        let scenario = ValidScenario::new(*scenario)?;
        self.mission_of(scenario).map(|_| ())
    }

    /// The mission of an episode with this scenario, if episodes are missions.
    ///
    /// # Errors
    /// A leg that cannot be flown.
    pub(crate) fn mission_of(
        &self,
        scenario: ValidScenario,
    ) -> Result<Option<ValidMission>, ConfigError> {
        let mission = self.mission.as_ref();
        mission
            .map(|mission| ValidMission::new(mission, scenario))
            .transpose()
    }

    /// Flat names of the parameters that are drawn for each episode.
    pub fn drawn(&self) -> Vec<&'static str> {
        let drawn = self.randomize.distributions();
        let named = PARAMETERS.iter().zip(drawn);
        named
            .filter_map(|(parameter, distribution)| distribution.map(|_| parameter.name))
            .collect()
    }

    /// Places in the mission's list of the legs that take time; none without a mission.
    pub fn timed_legs(&self) -> Vec<usize> {
        let legs = self.mission.iter().flat_map(|mission| &mission.legs);
        let timed = legs.enumerate().filter(|(_, leg)| leg.takes_time());
        timed.map(|(place, _)| place).collect()
    }

    /// Whether anything is drawn.
    fn draws(&self) -> bool {
        let drawn = self.randomize.distributions();
        drawn.iter().any(Option::is_some)
    }

    /// The configuration whose episodes are those of this one under overrides.
    ///
    /// # Errors
    /// A setting that a parameter cannot have.
    pub(crate) fn overridden(&self, overrides: &Overrides) -> Result<Self, ConfigError> {
        let mut config = self.clone();
        for (index, distribution) in overrides {
            if let Some(first) = distribution.extremes().first() {
                PARAMETERS[*index].set(&mut config.scenario, first)?;
            }
            *config.randomize.places()[*index] = match distribution {
                Distribution::Fixed(_) => None,
                drawn => Some(drawn.clone()),
            };
        }
        Ok(config)
    }

    /// Draws the scenario of one episode; overrides replace what was drawn without moving the
    /// other draws. Parameters that do not go together (a smoothing too long for the profile) are drawn
    /// again, all of them, from streams of their own.
    ///
    /// # Errors
    /// Overrides that cannot be set, or with which no draw can be flown.
    pub fn draw(
        &self,
        seed: Seed,
        episode: u64,
        overrides: &[&Overrides],
    ) -> Result<ValidScenario, ConfigError> {
        self.draw_within(MOST_ATTEMPTS, seed, episode, overrides)
    }

    /// Refuses overrides with which an episode, and so later ones, could hardly be drawn.
    pub(crate) fn check_overrides(
        &self,
        seed: Seed,
        episode: u64,
        overrides: &Overrides,
    ) -> Result<(), ConfigError> {
        self.draw_within(TRIALS, seed, episode, &[overrides])?;
        if overrides.iter().any(|(_, drawn)| drawn.draws()) {
            return self.overridden(overrides)?.validate();
        }
        Ok(())
    }

    fn draw_within(
        &self,
        attempts: u64,
        seed: Seed,
        episode: u64,
        overrides: &[&Overrides],
    ) -> Result<ValidScenario, ConfigError> {
        let drawn = |lists: &[&Overrides]| {
            let mut all = lists.iter().flat_map(|list| list.iter());
            all.any(|(_, distribution)| distribution.draws())
        };
        let first = match self.attempt(seed, episode, 0, overrides) {
            Err(first) if self.draws() || drawn(overrides) => first,
            found => return found,
        };
        let mut others = (1..attempts).map(|n| self.attempt(seed, episode, n, overrides));
        others.find(Result::is_ok).unwrap_or(Err(first))
    }

    /// One attempt at [`EnvConfig::draw`].
    fn attempt(
        &self,
        seed: Seed,
        episode: u64,
        attempt: u64,
        overrides: &[&Overrides],
    ) -> Result<ValidScenario, ConfigError> {
        let mut scenario = self.scenario;
        let drawn = self.randomize.distributions();
        for (parameter, distribution) in PARAMETERS.iter().zip(drawn) {
            if let Some(distribution) = distribution {
                let purpose = Purpose::Parameter(parameter.name);
                let mut stream = Stream::of_attempt(seed, episode, purpose, attempt);
                parameter.set(&mut scenario, &distribution.draw(&mut stream))?;
            }
        }
        let mut mass_drawn = self.randomize.payload_mass.is_some();
        for (index, distribution) in overrides.iter().flat_map(|list| list.iter()) {
            let parameter = &PARAMETERS[*index];
            let purpose = Purpose::Parameter(parameter.name);
            let mut stream = Stream::of_attempt(seed, episode, purpose, attempt);
            parameter.set(&mut scenario, &distribution.draw(&mut stream))?;
            mass_drawn |= parameter.name == "payload_mass" && distribution.draws();
        }
        if mass_drawn {
            scenario.hide_dimensions();
        }
        let scenario = ValidScenario::new(scenario)?;
        self.mission_of(scenario)?;
        Ok(scenario)
    }

    /// Samples in a control period.
    pub fn samples_per_action(&self) -> usize {
        (libm::round(self.task.control_period / self.scenario.sample_period) as usize).max(1)
    }

    /// Actions in an episode.
    pub fn actions_per_episode(&self) -> usize {
        self.scenario.samples().div_ceil(self.samples_per_action())
    }

    /// The JSON schema of a configuration.
    pub fn schema() -> Value {
        schemars::schema_for!(Self).to_value()
    }
}

/// Whether parts of a configuration have every field of the scenario and of the task.
fn is_whole(parts: &serde_json::Map<String, Value>, base: &Value) -> bool {
    ["scenario", "task"].iter().all(|name| {
        let size = |part: Option<&Value>| part.and_then(Value::as_object).map(|o| o.len());
        size(parts.get(*name)) == size(base.get(*name))
    })
}

/// The flat context of a scenario, in the order of [`PARAMETERS`].
pub fn context(scenario: &Scenario) -> [f64; COUNT] {
    std::array::from_fn(|i| PARAMETERS[i].value(scenario))
}
