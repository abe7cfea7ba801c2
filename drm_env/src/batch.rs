//! Many environments of one configuration, stepped together on several threads. Environment `i`
//! gives the same bits as a single one with its seed, whatever the batch and the threads.

use std::sync::{Arc, Mutex};

use rayon::prelude::*;

use crate::config::EnvConfig;
use crate::env::{Env, Outcome, check_finite};
use crate::error::{ConfigError, Error, SimulationError, SnapshotError};
use crate::metrics::Metrics;
use crate::parameter::Overrides;
use crate::rng::Seed;

/// What happens to an environment whose episode has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Autoreset {
    /// The next step resets it, ignores its action and returns reward 0.
    NextStep,
    /// The same step resets it; the last observation is kept apart.
    SameStep,
    /// The caller resets it.
    Disabled,
}

/// Results of one step, one row an environment.
#[derive(Debug)]
pub struct StepBuffers<'a> {
    /// Observations, `num_envs x observation_size`.
    pub observations: &'a mut [f32],
    /// Rewards.
    pub rewards: &'a mut [f64],
    /// Ended by divergence or at a limit.
    pub terminated: &'a mut [bool],
    /// Ended at the horizon.
    pub truncated: &'a mut [bool],
    /// The reward's terms, `num_envs x 3`.
    pub terms: &'a mut [f64],
}

/// What is kept of an episode that ended in the last step.
#[derive(Debug, Clone)]
pub struct Ended {
    /// Last observation.
    pub observation: Vec<f32>,
    /// Metrics.
    pub metrics: Metrics,
    /// Context of the episode.
    pub context: Vec<f64>,
}

#[derive(Debug, Clone)]
struct Slot {
    env: Env,
    /// The episode ended in an earlier step and the next one resets.
    waiting: bool,
    /// The last call began an episode.
    began: bool,
    ended: Option<Box<Ended>>,
}

/// A batch of environments.
#[derive(Debug)]
pub struct Batch {
    config: Arc<EnvConfig>,
    autoreset: Autoreset,
    slots: Vec<Slot>,
    threads: usize,
    pool: Pool,
}

/// Below this many integration steps in a call, threads cost more than they give.
const STEPS_WORTH_A_THREAD: usize = 400;

impl Batch {
    /// `count` environments; `threads` is the most that a call may use.
    ///
    /// # Errors
    /// A configuration that cannot be flown.
    pub fn new(
        config: Arc<EnvConfig>,
        count: usize,
        autoreset: Autoreset,
        threads: Option<usize>,
    ) -> Result<Self, ConfigError> {
        if count == 0 {
            return Err(ConfigError::value("num_envs", "must be at least 1", count));
        }
        if threads == Some(0) {
            return Err(ConfigError::value("num_threads", "must be at least 1", 0));
        }
        let env = Env::new(Arc::clone(&config))?;
        let available = std::thread::available_parallelism().map_or(1, usize::from);
        Ok(Self {
            slots: vec![
                Slot {
                    env,
                    waiting: false,
                    began: false,
                    ended: None,
                };
                count
            ],
            config,
            autoreset,
            threads: threads.unwrap_or(available),
            pool: Pool::default(),
        })
    }

    /// The configuration.
    pub fn config(&self) -> &EnvConfig {
        &self.config
    }

    /// Number of environments.
    pub fn len(&self) -> usize {
        self.slots.len()
    }

    /// Never: a batch has at least one environment.
    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// Entries of one observation.
    pub fn observation_size(&self) -> usize {
        self.slots
            .first()
            .map_or(0, |slot| slot.env.observation().len())
    }

    /// One environment.
    pub fn env(&self, index: usize) -> Option<&Env> {
        self.slots.get(index).map(|slot| &slot.env)
    }

    /// Begins an episode in every environment, or in those of the mask.
    ///
    /// # Errors
    /// Lists of the wrong length, or a scenario that cannot be flown: then nothing has changed.
    pub fn reset(
        &mut self,
        seeds: &[Option<Seed>],
        once: Option<&[Overrides]>,
        mask: Option<&[bool]>,
    ) -> Result<(), Error> {
        let count = self.slots.len();
        check_length("seed", count, seeds.len())?;
        if let Some(once) = once {
            check_length("options", count, once.len())?;
        }
        if let Some(mask) = mask {
            check_length("reset_mask", count, mask.len())?;
        }
        let none = Overrides::new();
        let mut next = Vec::new();
        for (i, slot) in self.slots.iter().enumerate() {
            if mask.is_none_or(|mask| mask[i]) {
                let mut env = slot.env.clone();
                env.reset(seeds[i], once.map_or(&none, |once| &once[i]))?;
                next.push((i, env));
            }
        }
        for slot in &mut self.slots {
            slot.began = false;
            slot.ended = None;
        }
        for (i, env) in next {
            self.slots[i].env = env;
            self.slots[i].waiting = false;
            self.slots[i].began = true;
        }
        Ok(())
    }

    /// Overrides what is drawn in every later episode of each environment, until called again.
    ///
    /// # Errors
    /// A list of the wrong length, or settings that cannot be flown: then nothing has changed.
    pub fn set_context(&mut self, settings: &[Overrides]) -> Result<(), Error> {
        check_length("context", self.slots.len(), settings.len())?;
        let mut envs: Vec<Env> = self.slots.iter().map(|slot| slot.env.clone()).collect();
        for (env, settings) in envs.iter_mut().zip(settings) {
            env.set_context(settings.clone())?;
        }
        for (slot, env) in self.slots.iter_mut().zip(envs) {
            slot.env = env;
        }
        Ok(())
    }

    /// One control period of every environment under `num_envs x actuators` actions.
    ///
    /// # Errors
    /// Arrays of the wrong length, entries that are not finite, environments that are not running:
    /// then nothing has changed. A scenario drawn on autoreset that cannot be flown.
    pub fn step(&mut self, actions: &[f32], out: &mut StepBuffers<'_>) -> Result<(), Error> {
        let count = self.slots.len();
        let width = self.config.task.actuators.len();
        let size = self.observation_size();
        if actions.len() != count * width {
            return Err(SimulationError::ActionSize {
                expected: count * width,
                got: actions.len(),
            }
            .into());
        }
        check_finite(actions)?;
        check_length("observations", count * size, out.observations.len())?;
        check_length("rewards", count, out.rewards.len())?;
        check_length("terminated", count, out.terminated.len())?;
        check_length("truncated", count, out.truncated.len())?;
        check_length("terms", count * 3, out.terms.len())?;
        for slot in &self.slots {
            if !slot.waiting {
                slot.env.check_running()?;
            }
        }
        let autoreset = self.autoreset;
        let failure = Mutex::new(None);
        let one = |(slot, action, row): (&mut Slot, &[f32], Row<'_>)| {
            if let Err(error) = slot.step(action, autoreset, row) {
                *failure
                    .lock()
                    .unwrap_or_else(std::sync::PoisonError::into_inner) = Some(error);
            }
        };
        let work = count * self.config.samples_per_action();
        if self.threads == 1 || work < STEPS_WORTH_A_THREAD {
            rows(&mut self.slots, actions, width, size, out).for_each(one);
        } else {
            let pool = self.pool.get(self.threads);
            // a few chunks a thread even out episodes of different cost
            let chunk = count.div_ceil(self.threads * 4).max(1);
            let mut parts: Vec<_> = rows(&mut self.slots, actions, width, size, out).collect();
            match pool {
                Some(pool) => pool.install(|| {
                    parts.par_chunks_mut(chunk).for_each(|part| {
                        for (slot, action, row) in part {
                            one((slot, action, row.reborrow()));
                        }
                    });
                }),
                None => parts.into_iter().for_each(one),
            }
        }
        match failure
            .into_inner()
            .unwrap_or_else(std::sync::PoisonError::into_inner)
        {
            None => Ok(()),
            Some(error) => Err(error.into()),
        }
    }

    /// Copies every observation, `num_envs x observation_size`.
    pub fn copy_observations(&self, out: &mut [f32]) {
        let size = self.observation_size();
        for (slot, row) in self.slots.iter().zip(out.chunks_exact_mut(size)) {
            row.copy_from_slice(slot.env.observation());
        }
    }

    /// Whether the last call began an episode in an environment.
    pub fn began(&self, index: usize) -> bool {
        self.slots.get(index).is_some_and(|slot| slot.began)
    }

    /// What is kept of the episode that ended in the last step, if one did.
    pub fn ended(&self, index: usize) -> Option<&Ended> {
        self.slots.get(index).and_then(|slot| slot.ended.as_deref())
    }

    /// Overrides what is drawn in every later episode of one environment, until called again.
    ///
    /// # Errors
    /// No such environment, or settings that cannot be flown: then nothing has changed.
    pub fn set_env_context(&mut self, index: usize, settings: Overrides) -> Result<(), Error> {
        self.slot(index)?
            .env
            .set_context(settings)
            .map_err(Into::into)
    }

    /// Snapshot of one environment: a single environment with the same configuration takes it too.
    ///
    /// # Errors
    /// No such environment.
    pub fn env_state(&self, index: usize) -> Result<Vec<u8>, Error> {
        let slot = self
            .slots
            .get(index)
            .ok_or_else(|| missing(index, self.slots.len()))?;
        Ok(slot.env.get_state())
    }

    /// Restores one environment from its snapshot or from that of a single environment.
    ///
    /// # Errors
    /// No such environment; damaged or foreign data. Nothing has changed then.
    pub fn set_env_state(&mut self, index: usize, bytes: &[u8]) -> Result<(), Error> {
        let autoreset = self.autoreset;
        let slot = self.slot(index)?;
        slot.env.set_state(bytes)?;
        slot.restored(autoreset);
        Ok(())
    }

    fn slot(&mut self, index: usize) -> Result<&mut Slot, Error> {
        let count = self.slots.len();
        self.slots
            .get_mut(index)
            .ok_or_else(|| missing(index, count).into())
    }

    /// Snapshot of every environment.
    pub fn get_state(&self) -> Vec<u8> {
        let states: Vec<Vec<u8>> = self.slots.iter().map(|slot| slot.env.get_state()).collect();
        // lists of bytes always serialise
        let body = postcard::to_allocvec(&states).unwrap_or_default();
        [
            SNAPSHOT_MAGIC.as_slice(),
            &crc32fast::hash(&body).to_le_bytes(),
            &body,
        ]
        .concat()
    }

    /// Restores what [`Batch::get_state`] of a batch of the same size and configuration returned.
    ///
    /// # Errors
    /// Damaged or foreign data, or a batch of another size; nothing has changed then.
    pub fn set_state(&mut self, bytes: &[u8]) -> Result<(), Error> {
        let damaged = |what: &dyn std::fmt::Display| SnapshotError::Damaged(what.to_string());
        let (magic, rest) = bytes
            .split_first_chunk::<4>()
            .ok_or(SnapshotError::Foreign)?;
        if magic != SNAPSHOT_MAGIC {
            return Err(SnapshotError::Foreign.into());
        }
        let (checksum, body) = rest
            .split_first_chunk::<4>()
            .ok_or_else(|| damaged(&"it is too short"))?;
        if crc32fast::hash(body) != u32::from_le_bytes(*checksum) {
            return Err(damaged(&"the checksum does not fit").into());
        }
        let states: Vec<Vec<u8>> = postcard::from_bytes(body).map_err(|e| damaged(&e))?;
        let (count, got) = (self.slots.len(), states.len());
        if count != got {
            let text = format!("it holds {got} environments, the batch has {count}");
            return Err(SnapshotError::Damaged(text).into());
        }
        let mut envs = Vec::with_capacity(count);
        for (slot, bytes) in self.slots.iter().zip(&states) {
            let mut env = slot.env.clone();
            env.set_state(bytes)?;
            envs.push(env);
        }
        for (slot, env) in self.slots.iter_mut().zip(envs) {
            slot.env = env;
            slot.restored(self.autoreset);
        }
        Ok(())
    }
}

const SNAPSHOT_MAGIC: &[u8; 4] = b"DRMb";

fn missing(index: usize, count: usize) -> ConfigError {
    ConfigError::value("index", format!("must be below {count}"), index)
}

/// One row of [`StepBuffers`].
struct Row<'a> {
    observation: &'a mut [f32],
    reward: &'a mut f64,
    terminated: &'a mut bool,
    truncated: &'a mut bool,
    terms: &'a mut [f64],
}

impl Row<'_> {
    fn reborrow(&mut self) -> Row<'_> {
        Row {
            observation: self.observation,
            reward: self.reward,
            terminated: self.terminated,
            truncated: self.truncated,
            terms: self.terms,
        }
    }
}

fn rows<'a>(
    slots: &'a mut [Slot],
    actions: &'a [f32],
    width: usize,
    size: usize,
    out: &'a mut StepBuffers<'_>,
) -> impl Iterator<Item = (&'a mut Slot, &'a [f32], Row<'a>)> {
    slots
        .iter_mut()
        .zip(actions.chunks_exact(width))
        .zip(out.observations.chunks_exact_mut(size))
        .zip(out.rewards.iter_mut())
        .zip(out.terminated.iter_mut().zip(out.truncated.iter_mut()))
        .zip(out.terms.chunks_exact_mut(3))
        .map(
            |(((((slot, action), observation), reward), (terminated, truncated)), terms)| {
                let row = Row {
                    observation,
                    reward,
                    terminated,
                    truncated,
                    terms,
                };
                (slot, action, row)
            },
        )
}

impl Slot {
    /// After the environment has been replaced: the next step resets what has ended, if steps do.
    fn restored(&mut self, autoreset: Autoreset) {
        self.waiting =
            autoreset == Autoreset::NextStep && self.env.has_reset() && !self.env.is_running();
        self.began = false;
        self.ended = None;
    }

    fn step(
        &mut self,
        action: &[f32],
        autoreset: Autoreset,
        row: Row<'_>,
    ) -> Result<(), ConfigError> {
        self.ended = None;
        self.began = false;
        let outcome = if self.waiting {
            self.env.reset(None, &Overrides::new())?;
            self.waiting = false;
            self.began = true;
            Outcome {
                reward: 0.0,
                terminated: false,
                truncated: false,
            }
        } else {
            self.env.step_checked(action)
        };
        row.terms.copy_from_slice(&self.env.reward_terms());
        if outcome.terminated || outcome.truncated {
            self.ended = Some(Box::new(Ended {
                observation: self.env.observation().to_vec(),
                metrics: self.env.metrics(),
                context: self.env.context().to_vec(),
            }));
            match autoreset {
                Autoreset::NextStep => self.waiting = true,
                Autoreset::Disabled => {}
                Autoreset::SameStep => {
                    self.env.reset(None, &Overrides::new())?;
                    self.began = true;
                }
            }
        }
        *row.reward = outcome.reward;
        *row.terminated = outcome.terminated;
        *row.truncated = outcome.truncated;
        row.observation.copy_from_slice(self.env.observation());
        Ok(())
    }
}

fn check_length(name: &'static str, expected: usize, got: usize) -> Result<(), SimulationError> {
    if expected == got {
        return Ok(());
    }
    Err(SimulationError::Length {
        name,
        expected,
        got,
    })
}

/// Threads, made at the first call that needs them and again in a forked process, which inherits
/// none.
#[derive(Debug, Default)]
pub(crate) struct Pool {
    made: Option<(u32, rayon::ThreadPool)>,
}

impl Pool {
    /// The threads, or none if the system gives none.
    pub(crate) fn get(&mut self, threads: usize) -> Option<&rayon::ThreadPool> {
        let process = std::process::id();
        if self
            .made
            .as_ref()
            .is_none_or(|(maker, _)| *maker != process)
        {
            if let Some((_, inherited)) = self.made.take() {
                // joining threads that exist in the parent alone would hang
                std::mem::forget(inherited);
            }
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            self.made = pool.ok().map(|pool| (process, pool));
        }
        self.made.as_ref().map(|(_, pool)| pool)
    }
}
