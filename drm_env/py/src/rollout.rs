//! Many manoeuvres flown from end to end, and the networks that may fly them.

use drm_env::config::law_from_json;
use drm_env::config::mission::ValidMission;
use drm_env::control::mlp::{Activation, Layer, Network as Engine, Output, Scratch};
use drm_env::error::{ConfigError, Error};
use drm_env::math::rng::Seed;
use drm_env::rollout::{self as flights, Flown, Options, Pilot, Recording, Schedule};
use drm_env::{interruption, memory};
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;

use crate::arrays::{Count, In1, In2, In3, Out2};
use crate::config::{Config, Flyables, LegRow, Manoeuvre, flyables, leg_rows};
use crate::error::{Failure, Outcome, check_shape, detached};
use crate::threads::within_processors;

/// A multilayer perceptron; see the class of the same name in the Python package.
#[pyclass(frozen, module = "drm_env._engine")]
pub(crate) struct Network(Engine);

/// What is called `name` in a list of names and meanings.
fn named<T: Copy>(path: &str, name: &str, known: &[(&str, T)]) -> Result<T, ConfigError> {
    let found = known.iter().find(|(candidate, _)| *candidate == name);
    found.map(|(_, meaning)| *meaning).ok_or_else(|| {
        let names: Vec<&str> = known.iter().map(|(name, _)| *name).collect();
        ConfigError::value(path, format!("must be one of {}", names.join(", ")), name)
    })
}

#[pymethods]
impl Network {
    /// Layers as weights (outputs, inputs) and biases (outputs,).
    #[new]
    #[allow(clippy::needless_pass_by_value)]
    fn new(
        py: Python<'_>,
        layers: Vec<(In2<f32>, In1<f32>)>,
        activation: &str,
        output: &str,
    ) -> Outcome<Self> {
        detached(py, || {
            let activations = [("tanh", Activation::Tanh), ("relu", Activation::Relu)];
            let activation = named("activation", activation, &activations)?;
            let outputs = [("clip", Output::Clip), ("tanh", Output::Tanh)];
            let output = named("output", output, &outputs)?;
            let mut plain = Vec::with_capacity(layers.len());
            for (index, (weights, biases)) in layers.iter().enumerate() {
                let (rows, count) = (weights.shape()[0], biases.slice().len());
                if rows != count {
                    let path = format!("layers[{index}].weights");
                    let requirement = format!("must have {count} rows, one for each bias");
                    return Err(ConfigError::value(path, requirement, rows));
                }
                plain.push(Layer {
                    weights: weights.slice().to_vec(),
                    biases: biases.slice().to_vec(),
                });
            }
            Ok(Self(Engine::new(&plain, activation, output)?))
        })
    }

    /// Entries of an observation.
    #[getter]
    fn inputs(&self) -> usize {
        self.0.inputs()
    }

    /// Entries of an action.
    #[getter]
    fn outputs(&self) -> usize {
        self.0.outputs()
    }

    /// Actions of observations, a row each: those of a rollout to the bit.
    fn act<'py>(&self, py: Python<'py>, observations: In2<f32>) -> Outcome<Out2<'py, f32>> {
        let (inputs, outputs) = (self.0.inputs(), self.0.outputs());
        let count = observations.shape()[0];
        check_shape("observations", observations.shape(), &[count, inputs])?;
        let rows = observations.slice();
        let actions = detached(py, || {
            let bytes = count as u128 * (outputs * size_of::<f32>()) as u128;
            memory::check("observations", count, bytes, None, "a smaller number")?;
            let mut actions = Vec::with_capacity(count * outputs);
            let mut action = vec![0.0; outputs];
            let mut scratch = Scratch::new();
            for row in rows.chunks_exact(inputs) {
                interruption::poll();
                let values: Vec<f64> = row.iter().map(|value| f64::from(*value)).collect();
                self.0.act(&values, &mut scratch, &mut action)?;
                actions.extend(action.iter().map(|value| *value as f32));
            }
            Ok::<_, Error>(actions)
        })?;
        Ok(Out2::new(py, (count, outputs), actions))
    }
}

/// Metrics, a row a manoeuvre; for each signal its values, a row a manoeuvre; peaks and root mean squares of
/// the loads, a row a manoeuvre.
pub(crate) type Returned<'py> = (
    Out2<'py, f64>,
    Vec<(&'static str, Out2<'py, f64>)>,
    Option<(Out2<'py, f64>, Out2<'py, f64>)>,
);

/// What is to be kept of manoeuvres.
pub(crate) fn recording(
    signals: Option<Vec<String>>,
    every: Count,
    loads: bool,
) -> Result<Option<Recording>, ConfigError> {
    if signals.is_none() && !loads {
        return Ok(None);
    }
    let kept = Recording::new(&signals.unwrap_or_default(), every.0)?;
    Ok(Some(if loads { kept.with_loads() } else { kept }))
}

/// What has been flown as arrays.
pub(crate) fn returned(py: Python<'_>, count: usize, flown: Flown) -> Returned<'_> {
    let rows: Vec<_> = flown.metrics.iter().map(|m| m.values()).collect();
    let mut kept = Vec::new();
    if let Some(trajectories) = flown.trajectories {
        let shape = (count, trajectories.samples);
        for (name, values) in trajectories.signals {
            kept.push((name, Out2::new(py, shape, values)));
        }
    }
    let loads = flown.loads.map(|loads| {
        let peaks = loads.iter().map(|loads| loads.peak).collect();
        let squares = loads.iter().map(|loads| loads.rms).collect();
        (Out2::matrix(py, peaks), Out2::matrix(py, squares))
    });
    (Out2::matrix(py, rows), kept, loads)
}

/// Legs of missions that have been flown, as Python takes them.
pub(crate) fn legs_of(missions: &[ValidMission], flown: &Flown) -> Vec<Vec<LegRow>> {
    let pairs = missions.iter().zip(&flown.legs);
    let legs = pairs.map(|(mission, legs)| leg_rows(mission.mission(), legs));
    legs.collect()
}

/// Flies many manoeuvres under a law (as JSON text), by a network in the task of a configuration, or
/// under torques (N m; each row, of root and tip wheel, is held for so many samples): metrics, a row a manoeuvre, for each signal its values, a row a manoeuvre, every
/// `every`-th sample, with `loads` their peaks and root mean squares, a row a manoeuvre each, and the legs of each mission. `progress(flown, all)` is called now and then; what it raises ends the work
/// and is raised here.
#[pyfunction]
#[pyo3(signature = (scenarios, pilot, seeds, num_threads, progress, signals, every, loads=false))]
#[allow(clippy::too_many_arguments, clippy::type_complexity)]
pub(crate) fn rollout<'py>(
    py: Python<'py>,
    scenarios: Vec<Manoeuvre>,
    pilot: (
        Option<String>,
        Option<(Py<Network>, Py<Config>)>,
        Option<(In3<f64>, Count)>,
    ),
    seeds: Vec<PyBackedBytes>,
    num_threads: Option<Count>,
    progress: Option<Py<PyAny>>,
    signals: Option<Vec<String>>,
    every: Count,
    loads: bool,
) -> Outcome<(Returned<'py>, Vec<Vec<LegRow>>)> {
    let num_threads = within_processors(py, num_threads)?;
    let mut raised: Option<PyErr> = None;
    let count = scenarios.len();
    if let Some((torques, _)) = &pilot.2 {
        let rows = torques.shape()[1];
        check_shape("torques", torques.shape(), &[count, rows, 2])?;
    }
    let schedule = pilot.2.as_ref().map(|(torques, hold)| Schedule {
        torques: torques.slice().as_chunks::<2>().0,
        rows: torques.shape()[1],
        hold: hold.0,
    });
    let (law_text, policy) = (&pilot.0, &pilot.1);
    let result = detached(py, || {
        let law;
        let pilot = match (law_text, policy, schedule) {
            (Some(text), None, None) => {
                law = law_from_json(text)?;
                Pilot::law(&law)?
            }
            (None, Some((network, config)), None) => {
                Pilot::network(&network.get().0, config.get().held())?
            }
            (None, None, Some(schedule)) => Pilot::schedule(schedule)?,
            _ => {
                let message = "give a law, a policy or torques";
                return Err(Error::from(ConfigError::form("pilot", message)));
            }
        };
        let recording = recording(signals, every, loads)?;
        let flown = flyables(&scenarios)?;
        let seeds: Vec<Seed> = seeds.iter().map(|seed| Seed::from_le_bytes(seed)).collect();
        let report = |flown: usize| {
            let Some(callback) = &progress else {
                return true;
            };
            let outcome = Python::attach(|py| callback.call1(py, (flown, count)).map(drop));
            outcome.map_err(|error| raised = Some(error)).is_ok()
        };
        let options = Options {
            threads: num_threads,
            recording,
            ..Options::default()
        };
        match flown {
            Flyables::Scenarios(scenarios) => {
                let flown = flights::fly(&scenarios, &pilot, &seeds, &options, report)?;
                Ok((flown, Vec::new()))
            }
            Flyables::Missions(missions) => {
                let flown = flights::fly_missions(&missions, &pilot, &seeds, &options, report)?;
                let legs = legs_of(&missions, &flown);
                Ok((flown, legs))
            }
        }
    });
    if let Some(error) = raised {
        return Err(Failure::from(error));
    }
    let (flown, legs) = result?;
    Ok((returned(py, count, flown), legs))
}
