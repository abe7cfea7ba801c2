//! Manoeuvres and missions under a law that is a Python callable.

use drm_env::error::Error;
use drm_env::math::rng::Seed;
use drm_env::rollout as flights;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;

use crate::arrays::{Count, In2, Out2};
use crate::config::{Flyables, LegRow, Manoeuvre, flyables};
use crate::error::{Failure, Outcome, check_shape, detached};
use crate::rollout::{Returned, legs_of, recording, returned};

/// Flies many manoeuvres or missions under a law that is called every `period` (s; without: every sample) with what it is
/// told of all of them, a row a manoeuvre, and returns torques of root and tip wheel (N m), a row a manoeuvre.
/// What it or `progress` raises ends the work and is raised here. The rest as `rollout`.
#[pyfunction]
#[pyo3(signature = (scenarios, law, period, seeds, progress, signals, every, loads))]
#[allow(clippy::too_many_arguments, clippy::type_complexity)]
pub(crate) fn rollout_asked<'py>(
    py: Python<'py>,
    scenarios: Vec<Manoeuvre>,
    law: Py<PyAny>,
    period: Option<f64>,
    seeds: Vec<PyBackedBytes>,
    progress: Option<Py<PyAny>>,
    signals: Option<Vec<String>>,
    every: Count,
    loads: bool,
) -> Outcome<(Returned<'py>, Vec<Vec<LegRow>>)> {
    let count = scenarios.len();
    let mut raised: Option<PyErr> = None;
    let mut raised_late: Option<PyErr> = None;
    let result = detached(py, || {
        let recording = recording(signals, every, loads)?;
        let flown = flyables(&scenarios)?;
        let seeds: Vec<Seed> = seeds.iter().map(|seed| Seed::from_le_bytes(seed)).collect();
        let mut asked = |told: &[[f64; flights::TOLD]]| {
            let torques = Python::attach(|py| -> PyResult<Vec<[f64; 2]>> {
                let told = Out2::matrix(py, told.to_vec());
                let answer = law.call1(py, (told,))?;
                let torques: In2<f64> = answer.bind(py).extract()?;
                check_shape("law's torques", torques.shape(), &[count, 2]).map_err(PyErr::from)?;
                Ok(torques.slice().as_chunks::<2>().0.to_vec())
            });
            torques.map_err(|error| raised = Some(error)).ok()
        };
        let mut report = |flown: usize| {
            let Some(callback) = &progress else {
                return true;
            };
            let outcome = Python::attach(|py| callback.call1(py, (flown, count)).map(drop));
            outcome.map_err(|error| raised_late = Some(error)).is_ok()
        };
        let recording = recording.as_ref();
        match flown {
            Flyables::Scenarios(scenarios) => {
                let flown = flights::fly_asked(
                    &scenarios,
                    &seeds,
                    period,
                    recording,
                    &mut asked,
                    &mut report,
                )?;
                Ok::<_, Error>((flown, Vec::new()))
            }
            Flyables::Missions(missions) => {
                let flown = flights::fly_missions_asked(
                    &missions,
                    &seeds,
                    period,
                    recording,
                    &mut asked,
                    &mut report,
                )?;
                let legs = legs_of(&missions, &flown);
                Ok((flown, legs))
            }
        }
    });
    if let Some(error) = raised.or(raised_late) {
        return Err(Failure::from(error));
    }
    let (flown, legs) = result?;
    Ok((returned(py, count, flown), legs))
}
