//! Configuration of an environment: a scenario, what is drawn for each episode, and the task.
//! Presets give the registered environments their defaults.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use serde_json::{Map, Value, json};

use crate::arm::{non_negative, positive};
use crate::control::Law;
use crate::distribution::Distribution;
use crate::error::ConfigError;
use crate::options::{apply_option, overlay, release_fixed};
use crate::parameter::{COUNT, Overrides, PARAMETERS, Randomize};
use crate::rng::{Purpose, Seed, Stream};
use crate::scenario::Scenario;
use crate::task::RewardScale;

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

/// The reward: minus a weighted sum of logarithmic errors, per second.
///
/// An error x (m) counts as ln(1 + x / resolution) / ln(1 + 1 m / resolution).
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
    /// Time by which the deflection rate is weighed, s: one over the angular frequency of the
    /// vibration, about 4 Hz.
    pub vibration_time: f64,
    /// Time by which the slew error rate is weighed, s.
    pub slew_time: f64,
}

impl Default for Reward {
    fn default() -> Self {
        Self {
            tip_vibration: 0.5,
            slew_error: 1.0,
            effort: 0.01,
            resolution: 1e-4,
            vibration_time: 0.04,
            slew_time: 2.5,
        }
    }
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

/// What the agent does, sees and is paid for.
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
            observation_history: 1,
            preview_times: vec![0.1, 0.25, 0.5, 1.0, 2.0],
            reward: Reward::default(),
            limits: Limits::default(),
        }
    }
}

/// Everything that defines an environment. The default is `drm_env/Slew-v0`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct EnvConfig {
    /// The manoeuvre, as far as it is not drawn.
    pub scenario: Scenario,
    /// What is drawn for each episode.
    pub randomize: Randomize,
    /// What the agent does, sees and is paid for.
    pub task: Task,
}

impl Default for EnvConfig {
    fn default() -> Self {
        let mut config = Self::fixed();
        config.randomize.payload_mass =
            Some(crate::distribution::Distribution::Uniform([50.0, 500.0]));
        config.randomize.mass_error =
            Some(crate::distribution::Distribution::Uniform([-0.15, 0.15]));
        config
    }
}

/// Names of the presets, one a registered environment.
pub const PRESETS: [&str; 4] = ["slew", "slew_residual", "slew_thesis", "slew_direct"];

/// Draws with which a configuration is tried, and attempts after which overrides are refused.
const TRIALS: u64 = 64;

/// So many of the [`TRIALS`] must be flyable: then that an episode cannot be drawn within
/// [`MOST_ATTEMPTS`] is out of the question.
const FEWEST_FLYABLE: usize = 8;

/// Attempts at drawing parameters that go together.
const MOST_ATTEMPTS: u64 = 1000;

/// Most that an episode may pay or cost: a single-precision number holds it.
const LARGEST_RETURN: f64 = 1e30;

impl EnvConfig {
    fn fixed() -> Self {
        Self {
            scenario: Scenario::default(),
            randomize: Randomize::default(),
            task: Task::default(),
        }
    }

    /// The defaults of a registered environment.
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
    pub fn from_json(text: &str) -> Result<Self, ConfigError> {
        Self::resolve(PRESETS[0], Some(text), None)
    }

    fn from_value(mut document: Value) -> Result<Self, ConfigError> {
        if let Some(law) = document.pointer_mut("/task/inner_law") {
            name_law(law);
        }
        let config: Self = typed(document)?;
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
    pub fn validate(&self) -> Result<(), ConfigError> {
        self.task.validate(&self.scenario)?;
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
            return lowest.validate();
        }
        let trials: Vec<_> = (0..TRIALS)
            .map(|episode| self.attempt(Seed::default(), episode, 0, &[]))
            .collect();
        let flyable = trials.iter().filter_map(|trial| trial.as_ref().ok());
        // an end is tried beside these
        let others: Vec<Scenario> = [&lowest, &highest]
            .into_iter()
            .filter(|ends| ends.validate().is_ok())
            .chain(flyable.clone())
            .copied()
            .collect();
        if others.is_empty() {
            return lowest.validate();
        }
        for (parameter, distribution) in PARAMETERS.iter().zip(&drawn) {
            for extreme in distribution.iter().flat_map(|d| d.extremes()) {
                let mut first = None;
                for mut scenario in others.iter().copied() {
                    parameter.set(&mut scenario, &extreme)?;
                    match scenario.validate() {
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
    ) -> Result<Scenario, ConfigError> {
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
    ) -> Result<Scenario, ConfigError> {
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
    ) -> Result<Scenario, ConfigError> {
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
        scenario.validate()?;
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

impl Task {
    fn validate(&self, scenario: &Scenario) -> Result<(), ConfigError> {
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
        if let Some(law) = &self.inner_law {
            law.validate().map_err(|e| e.within("inner_law"))?;
        }
        positive("wheel_scale", self.wheel_scale)?;
        if let Some(limit) = self.action_rate_limit {
            positive("action_rate_limit", limit)?;
        }
        if self.observe_identified && self.actuators.contains(&Actuator::SlewMotor) {
            return Err(ConfigError::value(
                "observe_identified",
                "must be false where the slew motor is the agent's: the momentum it gives is not known",
                true,
            ));
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
            vibration_time,
            slew_time,
        } = self.reward;
        for (name, value) in [
            ("tip_vibration", tip_vibration),
            ("slew_error", slew_error),
            ("effort", effort),
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

/// Reads a typed value, naming the path of what does not fit.
pub(crate) fn typed<T: DeserializeOwned>(document: Value) -> Result<T, ConfigError> {
    serde_path_to_error::deserialize(document).map_err(|e| {
        let path = e.path().to_string();
        ConfigError::form(path, e.into_inner())
    })
}

/// A JSON object from text.
pub(crate) fn object(name: &str, text: &str) -> Result<Map<String, Value>, ConfigError> {
    serde_json::from_str(text).map_err(|e| ConfigError::form(name, e))
}

/// `"linear"` stands for `{"name": "linear"}`.
pub(crate) fn name_law(law: &mut Value) {
    if let Value::String(name) = law {
        *law = json!({ "name": name });
    }
}

/// One scenario from JSON text; parts left out have their defaults.
///
/// # Errors
/// Malformed text, unknown names, values of the wrong type or out of range; each with its path.
pub fn scenario_from_json(text: &str) -> Result<Scenario, ConfigError> {
    let scenario: Scenario = typed(Value::Object(object("scenario", text)?))?;
    scenario.validate()?;
    Ok(scenario)
}

/// A law from JSON text: an object, or the bare name in quotes.
///
/// # Errors
/// An unknown name, unknown gains, or gains that are not finite.
pub fn law_from_json(text: &str) -> Result<Law, ConfigError> {
    let mut value: Value = serde_json::from_str(text).map_err(|e| ConfigError::form("law", e))?;
    name_law(&mut value);
    if let Some(name) = value.get("name").and_then(Value::as_str) {
        Law::named(name).map_err(|e| e.within("law"))?;
    }
    let law: Law = typed(value).map_err(|e| e.within("law"))?;
    law.validate().map_err(|e| e.within("law"))?;
    Ok(law)
}

/// The flat context of a scenario, in the order of [`PARAMETERS`].
pub fn context(scenario: &Scenario) -> [f64; COUNT] {
    std::array::from_fn(|i| PARAMETERS[i].value(scenario))
}
