//! Many environments.

use drm_env::batch::{Autoreset, Batch as Engine, COORDINATES, Ended, StepBuffers};
use drm_env::config::parameter::{COUNT, Overrides};
use drm_env::error::{ConfigError, Error};
use drm_env::math::rng::Seed;
use drm_env::simulation::metrics::METRIC_NAMES;
use drm_env::{Env, interruption, memory};
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;

use crate::arrays::{Count, In1, In2, InOut1, InOut2, Out1, Out2};
use crate::config::Config;
use crate::env::{picture_of_letters, settings, signals_now};
use crate::error::{Outcome, check_shape, detached};
use crate::kept::ScenarioDelta;
use crate::threads::within_processors;

/// Settings of every environment from JSON text.
fn all_settings(py: Python<'_>, texts: Vec<Option<String>>) -> Outcome<Vec<Overrides>> {
    detached(py, || {
        let one = |text: &Option<String>| {
            interruption::poll();
            settings(text.as_deref())
        };
        texts.iter().map(one).collect::<Result<_, Error>>()
    })
}

/// Many environments; see `DrmVectorEnv` in the Python package.
#[pyclass(frozen, module = "drm_env._engine")]
pub(crate) struct Batch {
    engine: ScenarioDelta<Engine>,
    num_envs: usize,
    action_size: usize,
    observation_size: usize,
    horizon_steps: usize,
}

impl Batch {
    /// The engine.
    pub(crate) fn engine(&self) -> &ScenarioDelta<Engine> {
        &self.engine
    }

    /// Looks at one environment.
    pub(crate) fn env<T: Send>(
        &self,
        py: Python<'_>,
        index: usize,
        work: impl FnOnce(&Env) -> Result<T, Error> + Send,
    ) -> Outcome<T> {
        self.engine.look(py, |engine| {
            let env = engine.env(index).ok_or_else(|| {
                let requirement = format!("must be below {}", engine.len());
                ConfigError::value("index", requirement, index)
            })?;
            work(&env)
        })
    }

    /// One value of every environment whose episode ended in the last step, `none` of the others.
    fn each<T: Send + Copy>(
        &self,
        py: Python<'_>,
        none: T,
        value: impl Fn(&Ended) -> T + Send + Sync,
    ) -> Outcome<Vec<T>> {
        let mut values = vec![none; self.num_envs];
        self.engine.look(py, |engine| {
            for (i, ended) in engine.ended() {
                values[i] = value(ended);
            }
            Ok(())
        })?;
        Ok(values)
    }
}

#[pymethods]
impl Batch {
    #[new]
    #[pyo3(signature = (config, num_envs, autoreset, num_threads, max_steps))]
    fn new(
        py: Python<'_>,
        config: &Config,
        num_envs: Count,
        autoreset: &str,
        num_threads: Option<Count>,
        max_steps: Option<Count>,
    ) -> Outcome<Self> {
        let (num_envs, num_threads) = (num_envs.0, within_processors(py, num_threads)?);
        let config = config.held();
        detached(py, || {
            let mode = match autoreset {
                "next_step" => Autoreset::NextStep,
                "same_step" => Autoreset::SameStep,
                "disabled" => Autoreset::Disabled,
                other => {
                    let requirement = "must be next_step, same_step or disabled";
                    return Err(Error::from(ConfigError::value(
                        "autoreset",
                        requirement,
                        other,
                    )));
                }
            };
            let mut engine = Engine::new(config.clone(), num_envs, mode, num_threads)?;
            if let Some(Count(steps)) = max_steps {
                engine = engine.limited(steps)?;
            }
            Ok(Self {
                num_envs,
                action_size: config.task.actuators.len(),
                observation_size: engine.observation_size(),
                horizon_steps: config.actions_per_episode(),
                engine: ScenarioDelta::new(engine),
            })
        })
    }

    /// Entries of one action.
    #[getter]
    fn action_size(&self) -> usize {
        self.action_size
    }

    /// Entries of one observation.
    #[getter]
    fn observation_size(&self) -> usize {
        self.observation_size
    }

    /// Actions in an episode that is not cut short.
    #[getter]
    fn horizon_steps(&self) -> usize {
        self.horizon_steps
    }

    /// Begins episodes everywhere or where the mask holds, with seeds as little-endian bytes and
    /// flat parameters as JSON text; writes every observation.
    #[pyo3(signature = (seeds, options, mask, observations))]
    fn reset(
        &self,
        py: Python<'_>,
        seeds: Vec<Option<PyBackedBytes>>,
        options: Vec<Option<String>>,
        mask: Option<In1<bool>>,
        mut observations: InOut2<'_, f32>,
    ) -> Outcome<()> {
        let shape = [self.num_envs, self.observation_size];
        check_shape("observations", observations.shape(), &shape)?;
        let mask = mask.as_ref().map(In1::slice);
        let once = all_settings(py, options)?;
        let out = observations.slice_mut();
        self.engine.with(py, move |engine| {
            let seeds: Vec<Option<Seed>> = seeds
                .iter()
                .map(|seed| seed.as_deref().map(Seed::from_le_bytes))
                .collect();
            engine.reset(&seeds, Some(&once), mask)?;
            engine.copy_observations(out);
            Ok(())
        })
    }

    /// One control period everywhere, written into the arrays; whether any environment has begun
    /// an episode and whether any has ended one.
    #[allow(clippy::too_many_arguments)]
    fn step(
        &self,
        py: Python<'_>,
        actions: In2<f32>,
        mut observations: InOut2<'_, f32>,
        mut rewards: InOut1<'_, f64>,
        mut terminated: InOut1<'_, bool>,
        mut truncated: InOut1<'_, bool>,
        mut terms: InOut2<'_, f64>,
    ) -> Outcome<(bool, bool)> {
        let n = self.num_envs;
        check_shape("actions", actions.shape(), &[n, self.action_size])?;
        check_shape(
            "observations",
            observations.shape(),
            &[n, self.observation_size],
        )?;
        check_shape("terms", terms.shape(), &[n, 3])?;
        check_shape("terminated", terminated.shape(), &[n])?;
        check_shape("truncated", truncated.shape(), &[n])?;
        let actions = actions.slice();
        let (mut ends, mut cuts) = (vec![false; n], vec![false; n]);
        let mut buffers = StepBuffers {
            observations: observations.slice_mut(),
            rewards: rewards.slice_mut(),
            terminated: &mut ends,
            truncated: &mut cuts,
            terms: terms.slice_mut(),
        };
        let events = self.engine.with(py, |engine| {
            engine.step(actions, &mut buffers)?;
            Ok((engine.any_began(), engine.any_ended()))
        })?;
        terminated.fill(&ends);
        truncated.fill(&cuts);
        Ok(events)
    }

    /// Writes every present observation.
    fn observations(&self, py: Python<'_>, mut out: InOut2<'_, f32>) -> Outcome<()> {
        let shape = [self.num_envs, self.observation_size];
        check_shape("observations", out.shape(), &shape)?;
        let out = out.slice_mut();
        self.engine.look(py, move |engine| {
            engine.copy_observations(out);
            Ok(())
        })
    }

    /// Place of the mission's leg under way in each environment; zeros where episodes are manoeuvres.
    fn legs<'py>(&self, py: Python<'py>) -> Outcome<Out1<'py, f64>> {
        let legs = self.engine.look(py, |engine| Ok(engine.legs()))?;
        let places = legs.into_iter().map(|leg| leg as f64).collect();
        Ok(Out1::vector(py, places))
    }

    /// `Env.mission_report` of the episodes that ended in the last step, a row an environment of so many
    /// entries; zeros elsewhere.
    fn mission_reports<'py>(&self, py: Python<'py>, size: usize) -> Outcome<Out2<'py, f64>> {
        let mut rows = vec![0.0; self.num_envs * size];
        self.engine.look(py, |engine| {
            for (i, ended) in engine.ended() {
                let count = size.min(ended.mission.len());
                rows[i * size..][..count].copy_from_slice(&ended.mission[..count]);
            }
            Ok(())
        })?;
        Ok(Out2::new(py, (self.num_envs, size), rows))
    }

    /// Whether each environment began an episode in the last call.
    fn reset_happened<'py>(&self, py: Python<'py>) -> Outcome<Out1<'py, bool>> {
        let mut began = vec![false; self.num_envs];
        self.engine.look(py, |engine| {
            for i in engine.began() {
                began[i] = true;
            }
            Ok(())
        })?;
        Ok(Out1::vector(py, began))
    }

    /// Writes every true context into columns, one an environment, in the order of `context_names`.
    fn contexts(&self, py: Python<'_>, mut out: InOut2<'_, f64>) -> Outcome<()> {
        let n = self.num_envs;
        check_shape("contexts", out.shape(), &[COUNT, n])?;
        let out = out.slice_mut();
        self.engine.look(py, move |engine| {
            for i in 0..n {
                interruption::poll();
                let context = engine.context(i).unwrap_or([f64::NAN; COUNT]);
                for (row, value) in context.into_iter().enumerate() {
                    out[row * n + i] = value;
                }
            }
            Ok(())
        })
    }

    /// Writes the true coordinates and rates, a row an environment.
    fn coordinates(&self, py: Python<'_>, mut out: InOut2<'_, f64>) -> Outcome<()> {
        check_shape("coordinates", out.shape(), &[self.num_envs, COORDINATES])?;
        let out = out.slice_mut();
        self.engine.look(py, move |engine| {
            for (i, row) in out.chunks_exact_mut(COORDINATES).enumerate() {
                interruption::poll();
                row.copy_from_slice(&engine.coordinates(i).unwrap_or([f64::NAN; COORDINATES]));
            }
            Ok(())
        })
    }

    /// Environments that began an episode in the last call, and their true contexts in columns.
    fn began_contexts<'py>(&self, py: Python<'py>) -> Outcome<(Vec<usize>, Out2<'py, f64>)> {
        let (places, contexts) = self.engine.look(py, |engine| {
            let places: Vec<usize> = engine.began().collect();
            let mut contexts = vec![0.0; COUNT * places.len()];
            for (column, i) in places.iter().enumerate() {
                interruption::poll();
                let context = engine.context(*i).unwrap_or([f64::NAN; COUNT]);
                for (row, value) in context.into_iter().enumerate() {
                    contexts[row * places.len() + column] = value;
                }
            }
            Ok((places, contexts))
        })?;
        let shape = (COUNT, places.len());
        Ok((places, Out2::new(py, shape, contexts)))
    }

    /// Last observation of the episodes that ended in the last step; zeros elsewhere.
    fn final_obs<'py>(&self, py: Python<'py>) -> Outcome<Out2<'py, f32>> {
        let size = self.observation_size;
        let mut rows = vec![0.0; self.num_envs * size];
        self.engine.look(py, |engine| {
            for (i, ended) in engine.ended() {
                rows[i * size..][..size].copy_from_slice(&ended.observation);
            }
            Ok(())
        })?;
        Ok(Out2::new(py, (self.num_envs, size), rows))
    }

    /// Metrics of the episodes that ended in the last step; zeros elsewhere.
    fn metrics<'py>(&self, py: Python<'py>) -> Outcome<Out2<'py, f64>> {
        let zeros = [0.0; METRIC_NAMES.len()];
        let rows = self.each(py, zeros, |ended| ended.metrics.values())?;
        Ok(Out2::matrix(py, rows))
    }

    /// Whether the episodes that ended in the last step diverged.
    fn diverged<'py>(&self, py: Python<'py>) -> Outcome<Out1<'py, bool>> {
        let flags = self.each(py, false, |ended| ended.metrics.diverged)?;
        Ok(Out1::vector(py, flags))
    }

    /// Whether the arm settled in the episodes that ended in the last step.
    fn success<'py>(&self, py: Python<'py>) -> Outcome<Out1<'py, bool>> {
        let flags = self.each(py, false, |ended| ended.metrics.settled)?;
        Ok(Out1::vector(py, flags))
    }

    /// Whether every environment has had an episode.
    fn has_reset(&self, py: Python<'_>) -> Outcome<bool> {
        self.engine.look(py, |engine| Ok(engine.has_reset()))
    }

    /// Flat scenario parameters of every later episode, as JSON text each, until called again.
    fn set_context(&self, py: Python<'_>, options: Vec<Option<String>>) -> Outcome<()> {
        let list = all_settings(py, options)?;
        self.engine.with(py, |engine| engine.set_context(&list))
    }

    /// The same for one environment.
    #[pyo3(signature = (index, options))]
    fn set_env_context(&self, py: Python<'_>, index: usize, options: Option<&str>) -> Outcome<()> {
        self.engine.with(py, |engine| {
            engine.set_env_context(index, settings(options)?)
        })
    }

    /// Everything that changes, as bytes.
    fn get_state(&self, py: Python<'_>) -> Outcome<Vec<u8>> {
        self.engine.look(py, |engine| {
            // each alone, all together, with their checksum, and Python's
            let one = engine.env_state(0)?.len();
            let bytes = 4 * one as u128 * engine.len() as u128;
            memory::check("num_envs", engine.len(), bytes, None, "a smaller number")?;
            Ok(engine.get_state())
        })
    }

    /// Restores what `get_state` returned.
    fn set_state(&self, py: Python<'_>, state: &[u8]) -> Outcome<()> {
        self.engine.with(py, |engine| engine.set_state(state))
    }

    /// The state of one environment, as `Env.get_state` returns it.
    fn env_state(&self, py: Python<'_>, index: usize) -> Outcome<Vec<u8>> {
        self.engine.look(py, |engine| engine.env_state(index))
    }

    /// Restores one environment.
    fn set_env_state(&self, py: Python<'_>, index: usize, state: &[u8]) -> Outcome<()> {
        self.engine
            .with(py, |engine| engine.set_env_state(index, state))
    }

    /// Names and present values of the signals of one environment.
    fn signals(&self, py: Python<'_>, index: usize) -> Outcome<Vec<(&'static str, f64)>> {
        self.env(py, index, signals_now)
    }

    /// A picture of one environment as text.
    fn render_ansi(&self, py: Python<'_>, index: usize) -> Outcome<String> {
        self.env(py, index, picture_of_letters)
    }
}

/// Lets a part of a later call of any batch panic, after so many others; for tests of what is left then.
#[pyfunction]
pub(crate) fn panic_after_parts(parts: usize) {
    drm_env::batch::panic_after_parts(parts);
}
