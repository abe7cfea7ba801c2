//! Configuration as text, and the names that go with it.

use drm_env::config::EnvConfig;
use drm_env::config::options::OPTIONS;
use drm_env::config::parameter::PARAMETERS;
use drm_env::env::observation;
use drm_env::env::reward::REWARD_NAMES;
use drm_env::error::{ConfigError, Error};
use drm_env::simulation::metrics::METRIC_NAMES;
use pyo3::prelude::*;
use serde_json::{Map, Value, json};

use crate::error::{Outcome, guarded};

/// A preset, overlaid with parts of a configuration and then with flat options, as complete JSON
/// text.
#[pyfunction]
#[pyo3(signature = (task, config, options))]
pub(crate) fn resolve_config(task: &str, config: Option<&str>, options: &str) -> Outcome<String> {
    guarded(|| {
        let resolved = EnvConfig::resolve(task, config, Some(options))?;
        Ok::<_, ConfigError>(resolved.to_json())
    })
}

/// The configuration behind a task's name, as complete JSON text.
#[pyfunction]
pub(crate) fn default_config_json(task: &str) -> Outcome<String> {
    guarded(|| EnvConfig::preset(task).map(|config| config.to_json()))
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

/// Name, unit, scale, lower and upper bound of each entry of the observation, in order.
#[pyfunction]
pub(crate) fn observation_layout(config: &str) -> Outcome<Vec<Entry>> {
    guarded(|| {
        let layout = observation::observation_layout(&EnvConfig::from_json(config)?.task);
        let rows = layout.into_iter().map(|entry| {
            let limit = observation::OBSERVATION_LIMIT;
            (
                entry.name,
                entry.unit.to_owned(),
                entry.scale,
                -limit,
                limit,
            )
        });
        Ok::<_, ConfigError>(rows.collect())
    })
}
