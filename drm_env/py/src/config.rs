//! Configuration as text, and the names that go with it.

use drm_env::config::mission::{Leg, Mission, ValidMission};
use drm_env::config::options::OPTIONS;
use drm_env::config::parameter::PARAMETERS;
use drm_env::config::scenario::ValidScenario;
use drm_env::config::{
    EnvConfig, PRESETS, ValidConfig, context, mission_from_json, scenario_from_json,
};
use drm_env::env::observation;
use drm_env::env::reward::REWARD_NAMES;
use drm_env::error::{ConfigError, Error};
use drm_env::interruption;
use drm_env::simulation::LegRecord;
use drm_env::simulation::identification::Identified;
use drm_env::simulation::metrics::METRIC_NAMES;
use pyo3::prelude::*;
use serde_json::{Map, Value, json};

use crate::arrays::{In2, Out2};
use crate::error::{Outcome, check_shape, detached, guarded};

/// A complete configuration that has been checked; it never changes.
#[pyclass(frozen, module = "drm_env._engine")]
pub(crate) struct Config(ValidConfig);

impl Config {
    /// What the engine holds.
    pub(crate) fn held(&self) -> &ValidConfig {
        &self.0
    }
}

/// A manoeuvre: as JSON text, or that of a configuration that draws nothing.
#[derive(FromPyObject)]
pub(crate) enum Manoeuvre {
    /// Is to be read and checked.
    Text(String),
    /// Has been checked.
    Held(Py<Config>),
}

impl Manoeuvre {
    /// What the engine flies: it is checked once. `name` is what it is called among others.
    pub(crate) fn scenario(&self, name: Option<&str>) -> Result<ValidScenario, ConfigError> {
        match self {
            Self::Text(text) => scenario_from_json(text).map_err(|error| match name {
                Some(name) => error.within(name),
                None => error,
            }),
            Self::Held(config) => {
                let config = config.get().held();
                config.manoeuvre().ok_or_else(|| {
                    let drawn = config.drawn().join(", ");
                    let got =
                        format!("a configuration that draws {drawn}; see drm_env.sample_scenarios");
                    let name = name.unwrap_or("scenario");
                    ConfigError::value(name, "must be one manoeuvre", got)
                })
            }
        }
    }
}

/// What is flown: a manoeuvre or a mission.
pub(crate) enum Flyable {
    Scenario(Box<ValidScenario>),
    Mission(Box<ValidMission>),
}

impl Manoeuvre {
    /// What the engine flies, be it a mission: text that names `mission`, or a configuration with one.
    pub(crate) fn flyable(&self, name: Option<&str>) -> Result<Flyable, ConfigError> {
        let mission = match self {
            Self::Text(text) if names_mission(text) => mission_from_json(text),
            Self::Held(config) if config.get().held().mission.is_some() => {
                let scenario = self.scenario(name)?;
                let config = config.get().held();
                match &config.mission {
                    Some(mission) => ValidMission::new(mission, scenario),
                    None => return Ok(Flyable::Scenario(Box::new(scenario))),
                }
            }
            _ => {
                let scenario = self.scenario(name)?;
                return Ok(Flyable::Scenario(Box::new(scenario)));
            }
        };
        let mission = mission.map_err(|error| match name {
            Some(name) => error.within(name),
            None => error,
        });
        mission.map(|mission| Flyable::Mission(Box::new(mission)))
    }
}

/// Whether JSON text is an object with the key `mission`.
fn names_mission(text: &str) -> bool {
    // scenarios, which are many, are not read twice
    text.contains("\"mission\"")
        && serde_json::from_str::<Map<String, Value>>(text)
            .is_ok_and(|document| document.contains_key("mission"))
}

/// Place, kind, beginning (s), reference angle there (rad), mass that was planned for (kg), momentum (N m s)
/// and energy (J) that came with a payload, sums of the reward's terms, and metrics.
pub(crate) type LegRow = (
    usize,
    &'static str,
    f64,
    f64,
    f64,
    (f64, f64),
    Vec<f64>,
    Vec<f64>,
);

/// Legs as Python takes them.
pub(crate) fn leg_rows(mission: &Mission, legs: &[LegRecord]) -> Vec<LegRow> {
    legs.iter()
        .map(|leg| {
            (
                leg.leg,
                mission.legs.get(leg.leg).map_or("", Leg::name),
                leg.start,
                leg.angle,
                leg.planned_mass,
                (leg.exchange.momentum, leg.exchange.energy),
                leg.terms.to_vec(),
                leg.metrics.values().to_vec(),
            )
        })
        .collect()
}

/// Manoeuvres or missions of a rollout.
pub(crate) enum Flyables {
    Scenarios(Vec<ValidScenario>),
    Missions(Vec<ValidMission>),
}

/// All that is flown in one rollout: either manoeuvres or missions.
pub(crate) fn flyables(given: &[Manoeuvre]) -> Result<Flyables, ConfigError> {
    let (mut scenarios, mut missions) = (Vec::new(), Vec::new());
    for (i, manoeuvre) in given.iter().enumerate() {
        interruption::poll();
        let name = format!("scenarios[{i}]");
        match manoeuvre.flyable(Some(&name))? {
            Flyable::Scenario(scenario) => scenarios.push(*scenario),
            Flyable::Mission(mission) => missions.push(*mission),
        }
        if !(scenarios.is_empty() || missions.is_empty()) {
            let message = "manoeuvres and missions cannot be flown in one rollout";
            return Err(ConfigError::form(name, message));
        }
    }
    if missions.is_empty() {
        return Ok(Flyables::Scenarios(scenarios));
    }
    Ok(Flyables::Missions(missions))
}

#[pymethods]
impl Config {
    /// A task's defaults, overlaid with parts of a configuration and then with flat options, both as
    /// JSON text.
    #[new]
    #[pyo3(signature = (task, config, options))]
    fn new(task: &str, config: Option<&str>, options: Option<&str>) -> Outcome<Self> {
        guarded(|| ValidConfig::resolve(task, config, options).map(Self))
    }

    /// JSON text with every field.
    fn to_json(&self) -> String {
        self.0.to_json()
    }

    /// Time between two actions, s.
    #[getter]
    fn control_period(&self) -> f64 {
        self.0.task.control_period
    }

    /// Period of laws, sensors and metrics, s.
    #[getter]
    fn sample_period(&self) -> f64 {
        self.0.scenario.sample_period
    }

    /// Duration of an episode that is not cut short, s.
    #[getter]
    fn horizon(&self) -> f64 {
        self.0.scenario.horizon
    }

    /// Actions in an episode that is not cut short.
    #[getter]
    fn horizon_steps(&self) -> usize {
        self.0.actions_per_episode()
    }

    /// Entries of an action.
    #[getter]
    fn action_size(&self) -> usize {
        self.0.task.actuators.len()
    }

    /// Places in the mission's list of the legs that take time; none where episodes are manoeuvres.
    #[getter]
    fn mission_legs(&self) -> Vec<usize> {
        self.0.timed_legs()
    }

    /// Flat names of the parameters that are drawn for each episode.
    #[getter]
    fn drawn(&self) -> Vec<&'static str> {
        self.0.drawn()
    }

    /// Parameters of the manoeuvre as far as it is not drawn, in the order of `context_names`.
    fn context(&self) -> Vec<f64> {
        context(&self.0.scenario).to_vec()
    }

    /// Derivatives of the identified mass error by slew rate and by the momentum of either wheel, a row an
    /// observation; `seen` has the columns error, slew rate, extension, payload mass, length and width.
    fn identification_slopes<'py>(
        &self,
        py: Python<'py>,
        seen: In2<f64>,
    ) -> Outcome<Out2<'py, f64>> {
        check_shape("seen", seen.shape(), &[seen.shape()[0], 6])?;
        let scenario = &self.0.scenario;
        let slopes = detached(py, || {
            let rows = seen.slice().as_chunks::<6>().0.iter();
            let slopes = rows.map(|[error, rate, extension, payload @ ..]| {
                interruption::poll();
                let identified = Identified {
                    error: *error,
                    rate: *rate,
                    extension: *extension,
                    payload: *payload,
                };
                identified.slopes(scenario)
            });
            Ok::<_, Error>(slopes.collect())
        })?;
        Ok(Out2::matrix(py, slopes))
    }

    /// Name, unit, scale, lower and upper bound of each entry of the observation, in order.
    fn observation_layout(&self) -> Vec<Entry> {
        let limit = observation::OBSERVATION_LIMIT;
        observation::observation_layout(&self.0.task)
            .into_iter()
            .map(|entry| {
                (
                    entry.name,
                    entry.unit.to_owned(),
                    entry.scale,
                    -limit,
                    limit,
                )
            })
            .collect()
    }
}

/// Names of the tasks that have defaults.
#[pyfunction]
pub(crate) fn task_names() -> Vec<&'static str> {
    PRESETS.to_vec()
}

/// The JSON schema of a configuration.
#[pyfunction]
pub(crate) fn schema_json() -> Outcome<String> {
    guarded(|| Ok::<_, Error>(EnvConfig::schema().to_string()))
}

/// Every flat option as JSON text: name -> path, unit, randomizable, description.
#[pyfunction]
pub(crate) fn option_names_json() -> Outcome<String> {
    guarded(|| {
        let entry = |path: String, unit: &str, randomizable: bool, description: &str| {
            json!({
                "path": path,
                "unit": unit,
                "randomizable": randomizable,
                "description": description,
            })
        };
        let drawn = PARAMETERS.iter().map(|p| {
            let path = format!("scenario.{}", p.path);
            (p.name.to_owned(), entry(path, p.unit, true, p.description))
        });
        let fixed = OPTIONS.iter().map(|(name, path, unit, description)| {
            let path = (*path).to_owned();
            ((*name).to_owned(), entry(path, unit, false, description))
        });
        let table: Map<String, Value> = drawn.chain(fixed).collect();
        Ok::<_, Error>(Value::Object(table).to_string())
    })
}

/// Flat names of the scenario's parameters, in the order of every context.
#[pyfunction]
pub(crate) fn context_names() -> Vec<&'static str> {
    PARAMETERS.iter().map(|p| p.name).collect()
}

/// Names of the reward's terms, as they stand in an info.
#[pyfunction]
pub(crate) fn reward_names() -> Vec<&'static str> {
    REWARD_NAMES.to_vec()
}

/// Names of the metrics, in the order of every list of them.
#[pyfunction]
pub(crate) fn metric_names() -> Vec<&'static str> {
    METRIC_NAMES.to_vec()
}

/// Name, unit, scale, lower and upper bound.
type Entry = (String, String, f64, f64, f64);
