//! One environment.

use drm_env::config::parameter::{Overrides, overrides};
use drm_env::env::reward::REWARD_NAMES;
use drm_env::error::{ConfigError, Error, SimulationError};
use drm_env::math::rng::Seed;
use drm_env::render::from_simulation::{magnification, moment, stage};
use drm_env::rollout::{SIGNAL_NAMES, signals_from};
use drm_env::simulation::Flight;
use drm_env::simulation::metrics::METRIC_NAMES;
use drm_env::{Env as Engine, EnvConfig, Scenario, render};
use pyo3::prelude::*;

use crate::arrays::{In1, Out1};
use crate::config::{Config, LegRow, leg_rows};
use crate::error::{Outcome, detached};
use crate::kept::ScenarioDelta;

/// Settings from JSON text; none from `None`.
pub(crate) fn settings(text: Option<&str>) -> Result<Overrides, Error> {
    Ok(text.map_or_else(|| Ok(Overrides::new()), overrides)?)
}

/// Refuses to look at an episode before there is one.
pub(crate) fn flight(engine: &Engine) -> Result<&Flight, Error> {
    if engine.has_reset() {
        return Ok(engine.flight());
    }
    Err(SimulationError::NotRunning("call reset first").into())
}

/// Names and values of the signals now.
pub(crate) fn signals_now(engine: &Engine) -> Result<Vec<(&'static str, f64)>, Error> {
    let flight = flight(engine)?;
    let values = signals_from(flight, flight.last_torques(), engine.leg());
    Ok(SIGNAL_NAMES.into_iter().zip(values).collect())
}

/// A scenario as JSON text.
fn scenario_text(scenario: &Scenario) -> String {
    // a struct of numbers and names always serialises
    serde_json::to_string(scenario).unwrap_or_default()
}

/// A scenario of a configuration as JSON text; with the mission, if there is one.
pub(crate) fn flown_text(config: &EnvConfig, scenario: &Scenario) -> String {
    let mission = config.mission.as_ref();
    mission.map_or_else(
        || scenario_text(scenario),
        |mission| serde_json::json!({"mission": mission, "scenario": scenario}).to_string(),
    )
}

/// The present state as a picture of letters.
pub(crate) fn picture_of_letters(engine: &Engine) -> Result<String, Error> {
    let now = moment(flight(engine)?);
    let scenario = engine.scenario();
    Ok(render::ansi(
        &stage(&scenario, magnification(&scenario))?,
        &now,
    ))
}

/// Entries of a report.
const REPORT: usize = REWARD_NAMES.len() + METRIC_NAMES.len() + 2;

/// See `Env.report`.
fn report(engine: &Engine) -> [f64; REPORT] {
    let metrics = engine.progress();
    let flags = [metrics.diverged, metrics.settled].map(|flag| if flag { 1.0 } else { 0.0 });
    let mut values = engine
        .reward_terms()
        .into_iter()
        .chain(metrics.values())
        .chain(flags)
        .map(|value| if value.is_finite() { value } else { f64::MAX });
    std::array::from_fn(|_| values.next().unwrap_or(f64::MAX))
}

/// One environment; see the class of the same name in the Python package.
#[pyclass(frozen, module = "drm_env._engine")]
pub(crate) struct Env {
    engine: ScenarioDelta<Engine>,
    action_size: usize,
    observation_size: usize,
    horizon_steps: usize,
}

impl Env {
    /// The engine.
    pub(crate) fn engine(&self) -> &ScenarioDelta<Engine> {
        &self.engine
    }
}

#[pymethods]
impl Env {
    #[new]
    fn new(py: Python<'_>, config: &Config) -> Outcome<Self> {
        let config = config.held();
        detached(py, || {
            let engine = Engine::new(config.clone())?;
            Ok::<_, ConfigError>(Self {
                action_size: config.task.actuators.len(),
                observation_size: engine.observation().len(),
                horizon_steps: config.actions_per_episode(),
                engine: ScenarioDelta::new(engine),
            })
        })
    }

    /// Entries of an action.
    #[getter]
    fn action_size(&self) -> usize {
        self.action_size
    }

    /// Entries of an observation.
    #[getter]
    fn observation_size(&self) -> usize {
        self.observation_size
    }

    /// Actions in an episode that is not cut short.
    #[getter]
    fn horizon_steps(&self) -> usize {
        self.horizon_steps
    }

    /// Begins an episode: the first of a seed (little-endian bytes), or the next one.
    #[pyo3(signature = (seed, options))]
    fn reset<'py>(
        &self,
        py: Python<'py>,
        seed: Option<&[u8]>,
        options: Option<&str>,
    ) -> Outcome<Out1<'py, f32>> {
        let seed = seed.map(Seed::from_le_bytes);
        let observation = self.engine.with(py, |engine| {
            engine.reset(seed, &settings(options)?)?;
            Ok(engine.observation().to_vec())
        })?;
        Ok(Out1::vector(py, observation))
    }

    /// Flat scenario parameters of every later episode, until called again.
    #[pyo3(signature = (options))]
    fn set_context(&self, py: Python<'_>, options: Option<&str>) -> Outcome<()> {
        self.engine
            .with(py, |engine| Ok(engine.set_context(settings(options)?)?))
    }

    /// One control period: observation, reward, terminated, truncated and the report.
    #[allow(clippy::type_complexity)]
    fn step<'py>(
        &self,
        py: Python<'py>,
        action: In1<f32>,
    ) -> Outcome<(Out1<'py, f32>, f64, bool, bool, Out1<'py, f64>)> {
        let action = action.slice();
        let (outcome, report, observation) = self.engine.with(py, |engine| {
            let outcome = engine.step(action)?;
            Ok((outcome, report(engine), engine.observation().to_vec()))
        })?;
        Ok((
            Out1::vector(py, observation),
            outcome.reward,
            outcome.terminated,
            outcome.truncated,
            Out1::vector(py, report.to_vec()),
        ))
    }

    /// The true context of the episode, in the order of `context_names`.
    fn context<'py>(&self, py: Python<'py>) -> Outcome<Out1<'py, f64>> {
        let values = self.engine.look(py, |engine| Ok(engine.context()))?;
        Ok(Out1::vector(py, values.to_vec()))
    }

    /// The last reward's terms, the metrics of the episode so far, whether it diverged and whether
    /// the arm has settled; the largest double where a number does not exist.
    fn report<'py>(&self, py: Python<'py>) -> Outcome<Out1<'py, f64>> {
        let values = self.engine.look(py, |engine| Ok(report(engine)))?;
        Ok(Out1::vector(py, values.to_vec()))
    }

    /// Whether there has been an episode at all.
    fn has_reset(&self, py: Python<'_>) -> Outcome<bool> {
        self.engine.look(py, |engine| Ok(engine.has_reset()))
    }

    /// Actions taken in this episode.
    fn steps(&self, py: Python<'_>) -> Outcome<u64> {
        self.engine.look(py, |engine| Ok(engine.steps()))
    }

    /// The manoeuvre of this episode as JSON text.
    fn scenario_json(&self, py: Python<'_>) -> Outcome<String> {
        self.engine.look(py, |engine| {
            flight(engine)?;
            Ok(flown_text(engine.config(), &engine.scenario()))
        })
    }

    /// Place of the mission's leg under way, and three sums of the reward's terms of every leg that takes
    /// time; empty where episodes are manoeuvres.
    fn mission_report<'py>(&self, py: Python<'py>) -> Outcome<Out1<'py, f64>> {
        let values = self.engine.look(py, |engine| Ok(engine.mission_report()))?;
        Ok(Out1::vector(py, values))
    }

    /// Legs of the mission flown in this episode, and the one under way.
    fn legs(&self, py: Python<'_>) -> Outcome<Vec<LegRow>> {
        self.engine.look(py, |engine| {
            flight(engine)?;
            let mission = engine.config().mission.as_ref();
            Ok(mission.map_or_else(Vec::new, |mission| leg_rows(mission, &engine.legs())))
        })
    }

    /// Names and present values of the signals.
    fn signals(&self, py: Python<'_>) -> Outcome<Vec<(&'static str, f64)>> {
        self.engine.look(py, signals_now)
    }

    /// Everything that changes, as bytes.
    fn get_state(&self, py: Python<'_>) -> Outcome<Vec<u8>> {
        self.engine.look(py, |engine| Ok(engine.get_state()))
    }

    /// Restores what `get_state` returned.
    fn set_state(&self, py: Python<'_>, state: &[u8]) -> Outcome<()> {
        self.engine.with(py, |engine| engine.set_state(state))
    }

    /// A picture as text.
    fn render_ansi(&self, py: Python<'_>) -> Outcome<String> {
        self.engine.look(py, picture_of_letters)
    }
}
