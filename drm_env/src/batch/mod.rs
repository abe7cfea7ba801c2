//! Many environments of one configuration, stepped together: side by side in the lanes of the
//! processor's registers and on several threads. Environment `i` gives the same bits as a single one
//! with its seed, whatever the batch, the lanes and the threads.

mod thread_pool;

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::batch::thread_pool::Pool;
use crate::config::parameter::Overrides;
use crate::config::{EnvConfig, ValidConfig};
use crate::env::Env;
use crate::env::any_pack::{AnyEnvPack, Rows, packs};
pub use crate::env::any_pack::{COORDINATES, Ended};
use crate::env::episode::Draft;
use crate::env::episode::Phase;
use crate::env::episode::check_finite;
use crate::env::episode::check_phase;
use crate::env::setup::Setup;
use crate::error::{ConfigError, Error, SimulationError, SnapshotError};
use crate::interruption;
use crate::math::rng::Seed;
use crate::simd::Instructions;
use crate::simd::mask::lanes_of;

pub use crate::batch::thread_pool::panic_after_parts;

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

/// Environments that are stepped side by side, and what a batch keeps of each; flags are a bit a lane.
#[derive(Debug)]
struct Group {
    pack: Box<dyn AnyEnvPack>,
    /// Lanes in use: the first ones.
    count: usize,
    /// An episode is under way.
    running: u32,
    /// The episode ended in an earlier step and the next one resets.
    waiting: u32,
    /// The last call began an episode.
    began: u32,
    /// Episodes that ended in the last step, by lane.
    ended: Vec<(usize, Box<Ended>)>,
    /// What the waiting lanes begin with in this step.
    drafts: Vec<(usize, Draft)>,
}

/// A batch of environments.
#[derive(Debug)]
pub struct Batch {
    config: ValidConfig,
    autoreset: Autoreset,
    groups: Vec<Group>,
    count: usize,
    /// Environments in every group but the last ones.
    width: usize,
    /// Whether every environment is known to be running or to be reset by the next step: to ask the
    /// groups is to fetch them from the caches of other threads.
    ready: bool,
    /// Whether the last call began an episode in any environment; kept here for the same reason.
    any_began: bool,
    /// Whether the last step ended an episode in any environment.
    any_ended: bool,
    /// Whether the next step resets any environment.
    any_waiting: bool,
    /// Why an environment could not be reset within the last step.
    failure: Option<ConfigError>,
    threads: usize,
    pool: Pool,
}

/// What a caller keeps of each environment, bytes, about: contexts, results of a step, seeds.
const CALLER_BYTES: usize = 512;

/// Below this many samples in a call, threads cost more than they give.
const SAMPLES_WORTH_A_THREAD: usize = 200;

impl Batch {
    /// `count` environments; `threads` is the most that a call may use.
    ///
    /// # Errors
    /// A configuration that cannot be flown.
    pub fn new(
        config: impl TryInto<ValidConfig, Error: Into<ConfigError>>,
        count: usize,
        autoreset: Autoreset,
        threads: Option<usize>,
    ) -> Result<Self, ConfigError> {
        let widest = Instructions::detect();
        Self::with_instructions(config, count, autoreset, threads, widest)
    }

    /// Truncates episodes after at most so many actions from now on; nothing else of them changes,
    /// what ending early costs included. To be called before the first reset.
    ///
    /// # Errors
    /// No action at all.
    pub fn limited(mut self, actions: usize) -> Result<Self, ConfigError> {
        if actions == 0 {
            let requirement = "must be at least 1";
            return Err(ConfigError::value("max_episode_steps", requirement, 0));
        }
        let setup = Setup::limited(&self.config, Some(actions));
        for group in &mut self.groups {
            group.pack.set_up(&setup);
        }
        Ok(self)
    }

    /// [`Batch::new`] with instructions that the processor has; the results do not depend on them.
    ///
    /// # Errors
    /// A configuration that cannot be flown; instructions that the processor does not have.
    pub fn with_instructions(
        config: impl TryInto<ValidConfig, Error: Into<ConfigError>>,
        count: usize,
        autoreset: Autoreset,
        threads: Option<usize>,
        instructions: Instructions,
    ) -> Result<Self, ConfigError> {
        if count == 0 {
            return Err(ConfigError::value("num_envs", "must be at least 1", count));
        }
        if threads == Some(0) {
            return Err(ConfigError::value("num_threads", "must be at least 1", 0));
        }
        let config = config.try_into().map_err(Into::into)?;
        let env = Env::with_setup(Setup::new(&config))?;
        let available = std::thread::available_parallelism().map_or(1, usize::from);
        // what a call makes of each: drafts of a reset, or snapshots and their copies; and the caller's
        let each = 2 * size_of::<Draft>() + 4 * size_of_val(env.observation()) + CALLER_BYTES;
        let packs = packs(&env, count, instructions, each)?;
        let width = packs.first().map_or(1, |pack| pack.width());
        let mut left = count;
        let number = packs.len();
        let groups = packs
            .into_iter()
            .map(|pack| {
                let used = left.min(pack.width());
                left -= used;
                Group {
                    pack,
                    count: used,
                    running: 0,
                    waiting: 0,
                    began: 0,
                    ended: Vec::new(),
                    drafts: Vec::new(),
                }
            })
            .collect();
        Ok(Self {
            config,
            autoreset,
            groups,
            count,
            width,
            ready: false,
            any_began: false,
            any_ended: false,
            any_waiting: false,
            failure: None,
            // with more than groups some would have nothing to do
            threads: threads.unwrap_or(available).min(number),
            pool: Pool::default(),
        })
    }

    /// The configuration.
    pub fn config(&self) -> &EnvConfig {
        &self.config
    }

    /// Number of environments.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Never: a batch has at least one environment.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Entries of one observation.
    pub fn observation_size(&self) -> usize {
        self.groups
            .first()
            .map_or(0, |group| group.pack.observation_of(0).len())
    }

    /// Group and lane of an environment.
    fn place(&self, index: usize) -> Option<(usize, usize)> {
        if index >= self.count {
            return None;
        }
        // all groups but the last ones have the same width
        let (mut group, mut lane) = (index / self.width, index % self.width);
        group = group.min(self.groups.len() - 1);
        let mut first = group * self.width;
        lane = lane.max(index - first);
        while lane >= self.groups[group].count {
            first += self.groups[group].count;
            lane = index - first;
            group += 1;
        }
        Some((group, lane))
    }

    /// A copy of one environment.
    pub fn env(&self, index: usize) -> Option<Env> {
        let (group, lane) = self.place(index)?;
        Some(self.groups[group].pack.one(lane))
    }

    /// Every environment as group and lane, in order.
    fn places(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let counts: Vec<usize> = self.groups.iter().map(|group| group.count).collect();
        counts
            .into_iter()
            .enumerate()
            .flat_map(|(group, count)| (0..count).map(move |lane| (group, lane)))
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
        let count = self.count;
        check_length("seed", count, seeds.len())?;
        if let Some(once) = once {
            check_length("options", count, once.len())?;
        }
        if let Some(mask) = mask {
            check_length("reset_mask", count, mask.len())?;
        }
        let none = Overrides::new();
        let drafts = interruption::still(|| {
            let mut drafts = Vec::with_capacity(count);
            for (i, (group, lane)) in self.places().enumerate() {
                if mask.is_none_or(|mask| mask[i]) {
                    interruption::poll();
                    let pack = &self.groups[group].pack;
                    let draft = pack.draw(lane, seeds[i], once.map_or(&none, |once| &once[i]))?;
                    drafts.push((group, lane, draft));
                }
            }
            Ok::<_, ConfigError>(drafts)
        })?;
        for group in &mut self.groups {
            group.began = 0;
            group.ended.clear();
        }
        for (group, lane, draft) in drafts {
            interruption::poll();
            let group = &mut self.groups[group];
            group.pack.begin(lane, &draft)?;
            group.running |= 1 << lane;
            group.waiting &= !(1 << lane);
            group.began |= 1 << lane;
        }
        self.recount();
        Ok(())
    }

    /// Asks the groups what the last call, which was no step, has left.
    fn recount(&mut self) {
        self.failure = None;
        self.any_waiting = self.groups.iter().any(|group| group.waiting != 0);
        self.any_began = self.groups.iter().any(|group| group.began != 0);
        self.any_ended = self.groups.iter().any(|group| !group.ended.is_empty());
    }

    /// Overrides what is drawn in every later episode of each environment, until called again.
    ///
    /// # Errors
    /// A list of the wrong length, or settings that cannot be flown: then nothing has changed.
    pub fn set_context(&mut self, settings: &[Overrides]) -> Result<(), Error> {
        check_length("context", self.count, settings.len())?;
        interruption::still(|| {
            let mut last = None;
            for ((group, lane), settings) in self.places().zip(settings) {
                interruption::poll();
                // what many have in common is judged once
                if last.replace(settings) != Some(settings) {
                    self.groups[group].pack.check_context(lane, settings)?;
                }
            }
            Ok::<_, ConfigError>(())
        })?;
        for ((group, lane), settings) in self.places().zip(settings) {
            interruption::poll();
            self.groups[group].pack.set_context(lane, settings.clone());
        }
        Ok(())
    }

    /// One control period of every environment under `num_envs x actuators` actions.
    ///
    /// # Errors
    /// Arrays of the wrong length, entries that are not finite, environments that are not running, a
    /// scenario drawn on autoreset that cannot be flown: nothing has changed then. Where the same step
    /// resets, the episode stays ended and the *next* step says why, until the environment is reset.
    pub fn step(&mut self, actions: &[f32], out: &mut StepBuffers<'_>) -> Result<(), Error> {
        let count = self.count;
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
        if let Some(error) = &self.failure {
            return Err(error.clone().into());
        }
        if !self.ready {
            for group in &self.groups {
                for lane in lanes_of(group.everyone() & !(group.running | group.waiting)) {
                    check_phase(group.pack.phase(lane))?;
                }
            }
        }
        let autoreset = self.autoreset;
        // unless the step comes to a good end
        self.ready = false;
        // what cannot be drawn is known before anything moves
        if self.any_waiting {
            for group in &mut self.groups {
                group.draw()?;
            }
        }
        let failure = Mutex::new(None);
        let (began, ended) = (AtomicBool::new(false), AtomicBool::new(false));
        let work = count * self.config.samples_per_action();
        let threads = if work < SAMPLES_WORTH_A_THREAD {
            1
        } else {
            self.threads
        };
        let rows = Rows {
            observations: &mut *out.observations,
            rewards: &mut *out.rewards,
            terminated: &mut *out.terminated,
            truncated: &mut *out.truncated,
            terms: &mut *out.terms,
        };
        let shares = shares(&mut self.groups, self.width, actions, rows, threads);
        let one = |(group, actions, rows): (&mut Group, &[f32], Rows<'_>)| {
            if let Err(error) = group.step(actions, autoreset, rows) {
                *failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
            }
            // seldom written, so that they stay in every thread's cache
            if group.began != 0 {
                began.store(true, Ordering::Relaxed);
            }
            if !group.ended.is_empty() {
                ended.store(true, Ordering::Relaxed);
            }
        };
        self.pool.share(threads, shares, one);
        self.any_began = began.into_inner();
        self.any_ended = ended.into_inner();
        self.any_waiting = self.any_ended && autoreset == Autoreset::NextStep;
        self.failure = failure.into_inner().unwrap_or_else(PoisonError::into_inner);
        self.ready = autoreset != Autoreset::Disabled && self.failure.is_none();
        Ok(())
    }

    /// Copies every observation, `num_envs x observation_size`.
    pub fn copy_observations(&self, out: &mut [f32]) {
        let size = self.observation_size();
        for ((group, lane), row) in self.places().zip(out.chunks_exact_mut(size)) {
            row.copy_from_slice(self.groups[group].pack.observation_of(lane));
        }
    }

    /// Whether the last call began an episode in any environment.
    pub fn any_began(&self) -> bool {
        self.any_began
    }

    /// Whether the last step ended an episode in any environment.
    pub fn any_ended(&self) -> bool {
        self.any_ended
    }

    /// Environments in which the last call began an episode, in order.
    pub fn began(&self) -> impl Iterator<Item = usize> + '_ {
        self.firsts()
            .flat_map(|(first, group)| lanes_of(group.began).map(move |lane| first + lane))
    }

    /// What is kept of the episodes that ended in the last step, with their environments, in order.
    pub fn ended(&self) -> impl Iterator<Item = (usize, &Ended)> + '_ {
        self.firsts().flat_map(|(first, group)| {
            let ended = group.ended.iter();
            ended.map(move |(lane, ended)| (first + lane, &**ended))
        })
    }

    /// Groups with the index of their first environment.
    fn firsts(&self) -> impl Iterator<Item = (usize, &Group)> + '_ {
        self.groups.iter().scan(0, |next, group| {
            let first = *next;
            *next += group.count;
            Some((first, group))
        })
    }

    /// The true context of one environment, in the order of [`crate::config::parameter::PARAMETERS`].
    pub fn context(&self, index: usize) -> Option<[f64; crate::config::parameter::COUNT]> {
        let (group, lane) = self.place(index)?;
        Some(self.groups[group].pack.context(lane))
    }

    /// Places in the mission's list of the legs under way; zeros of manoeuvres.
    pub fn legs(&self) -> Vec<usize> {
        let places = self.places();
        places
            .map(|(group, lane)| self.groups[group].pack.leg(lane))
            .collect()
    }

    /// True slew angle (rad) and half the deflections of the links' ends (m), then their rates, of
    /// one environment: what its sensors do not tell.
    pub fn coordinates(&self, index: usize) -> Option<[f64; COORDINATES]> {
        let (group, lane) = self.place(index)?;
        Some(self.groups[group].pack.coordinates(lane))
    }

    /// Whether every environment has had an episode.
    pub fn has_reset(&self) -> bool {
        self.places()
            .all(|(group, lane)| self.groups[group].pack.phase(lane) != Phase::Fresh)
    }

    /// Overrides what is drawn in every later episode of one environment, until called again.
    ///
    /// # Errors
    /// No such environment, or settings that cannot be flown: then nothing has changed.
    pub fn set_env_context(&mut self, index: usize, settings: Overrides) -> Result<(), Error> {
        let (group, lane) = self.known(index)?;
        let pack = &mut self.groups[group].pack;
        pack.check_context(lane, &settings)?;
        pack.set_context(lane, settings);
        Ok(())
    }

    /// Snapshot of one environment: a single environment with the same configuration takes it too.
    ///
    /// # Errors
    /// No such environment.
    pub fn env_state(&self, index: usize) -> Result<Vec<u8>, Error> {
        let (group, lane) = self.known(index)?;
        Ok(self.groups[group].pack.one(lane).get_state())
    }

    /// Restores one environment from its snapshot or from that of a single environment.
    ///
    /// # Errors
    /// No such environment; damaged or foreign data. Nothing has changed then.
    pub fn set_env_state(&mut self, index: usize, bytes: &[u8]) -> Result<(), Error> {
        let (group, lane) = self.known(index)?;
        let autoreset = self.autoreset;
        self.ready = false;
        let group = &mut self.groups[group];
        let mut env = group.pack.one(lane);
        env.set_state(bytes)?;
        group.restore(lane, &env, autoreset);
        self.recount();
        Ok(())
    }

    fn known(&self, index: usize) -> Result<(usize, usize), ConfigError> {
        self.place(index).ok_or_else(|| {
            ConfigError::value("index", format!("must be below {}", self.count), index)
        })
    }

    /// Snapshot of every environment.
    pub fn get_state(&self) -> Vec<u8> {
        let states: Vec<Vec<u8>> = self
            .places()
            .map(|(group, lane)| {
                interruption::poll();
                self.groups[group].pack.one(lane).get_state()
            })
            .collect();
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
        let (count, got) = (self.count, states.len());
        if count != got {
            let text = format!("it holds {got} environments, the batch has {count}");
            return Err(SnapshotError::Damaged(text).into());
        }
        let envs = interruption::still(|| {
            let mut envs = Vec::with_capacity(count);
            for ((group, lane), bytes) in self.places().zip(&states) {
                interruption::poll();
                let mut env = self.groups[group].pack.one(lane);
                env.set_state(bytes)?;
                envs.push(env);
            }
            Ok::<_, Error>(envs)
        })?;
        let autoreset = self.autoreset;
        self.ready = false;
        for ((group, lane), env) in self.places().zip(envs) {
            interruption::poll();
            self.groups[group].restore(lane, &env, autoreset);
        }
        self.recount();
        Ok(())
    }
}

const SNAPSHOT_MAGIC: &[u8; 4] = b"DRMb";

/// Groups with their actions and rows, in so many shares; all but the last group have `width`
/// environments.
fn shares<'a>(
    groups: &'a mut [Group],
    width: usize,
    actions: &'a [f32],
    rows: Rows<'a>,
    threads: usize,
) -> impl Iterator<
    Item = impl DoubleEndedIterator<Item = (&'a mut Group, &'a [f32], Rows<'a>)> + ExactSizeIterator,
> {
    let (all, count) = (groups.len(), rows.rewards.len());
    let (size, actuators) = (rows.observations.len() / count, actions.len() / count);
    let mut left = (groups, actions, rows);
    (0..threads).map(move |thread| {
        let bound = |thread: usize| thread * all / threads;
        let n = bound(thread + 1) - bound(thread);
        let environments = (n * width).min(left.2.rewards.len());
        let groups = front(&mut left.0, n);
        let (actions, rest) = left.1.split_at(environments * actuators);
        left.1 = rest;
        let rows = &mut left.2;
        let observations = front(&mut rows.observations, environments * size);
        let rewards = front(&mut rows.rewards, environments);
        let terminated = front(&mut rows.terminated, environments);
        let truncated = front(&mut rows.truncated, environments);
        let terms = front(&mut rows.terms, environments * 3);
        groups
            .iter_mut()
            .zip(actions.chunks(width * actuators))
            .zip(observations.chunks_mut(width * size))
            .zip(rewards.chunks_mut(width))
            .zip(terminated.chunks_mut(width))
            .zip(truncated.chunks_mut(width))
            .zip(terms.chunks_mut(width * 3))
            .map(
                |(
                    (((((group, actions), observations), rewards), terminated), truncated),
                    terms,
                )| {
                    let rows = Rows {
                        observations,
                        rewards,
                        terminated,
                        truncated,
                        terms,
                    };
                    (group, actions, rows)
                },
            )
    })
}

/// Splits the first entries off.
fn front<'a, V>(slice: &mut &'a mut [V], count: usize) -> &'a mut [V] {
    let (first, rest) = std::mem::take(slice).split_at_mut(count);
    *slice = rest;
    first
}

impl Group {
    /// A bit for each lane in use.
    fn everyone(&self) -> u32 {
        (1_u32 << self.count).wrapping_sub(1)
    }

    /// A lane's environment has been replaced: the next step resets what has ended, if steps do.
    fn restore(&mut self, lane: usize, env: &Env, autoreset: Autoreset) {
        let bit = 1 << lane;
        self.pack.put(lane, env);
        self.running &= !bit;
        if env.is_running() {
            self.running |= bit;
        }
        self.waiting &= !bit;
        if autoreset == Autoreset::NextStep && env.has_reset() && !env.is_running() {
            self.waiting |= bit;
        }
        self.began &= !bit;
        self.ended.retain(|(ended, _)| *ended != lane);
    }

    /// Draws what the waiting lanes begin with in this step.
    ///
    /// # Errors
    /// A scenario that cannot be flown; nothing has moved then.
    fn draw(&mut self) -> Result<(), ConfigError> {
        let waiting = self.waiting & self.everyone();
        let drafts = lanes_of(waiting).map(|lane| {
            let draft = self.pack.draw(lane, None, &Overrides::new())?;
            Ok((lane, draft))
        });
        self.drafts = drafts.collect::<Result<_, ConfigError>>()?;
        Ok(())
    }

    /// # Errors
    /// A scenario that cannot be flown, of a lane whose episode stays ended.
    fn step(
        &mut self,
        actions: &[f32],
        autoreset: Autoreset,
        mut rows: Rows<'_>,
    ) -> Result<(), ConfigError> {
        let mut failure = Ok(());
        self.ended.clear();
        self.began = 0;
        let begin = self.waiting & self.everyone();
        let flying = self.everyone() & !begin;
        self.pack.step(actions, flying, &mut rows);
        for (lane, draft) in std::mem::take(&mut self.drafts) {
            self.pack.begin(lane, &draft)?;
            self.pack.write(lane, 0.0, &mut rows);
        }
        self.waiting = 0;
        self.running |= begin;
        self.began = begin;
        let ended = (0..self.count)
            .filter(|lane| rows.terminated[*lane] || rows.truncated[*lane])
            .fold(0_u32, |bits, lane| bits | 1 << lane);
        self.running &= !ended;
        for lane in lanes_of(ended) {
            self.ended.push((lane, Box::new(self.pack.end(lane))));
            match autoreset {
                Autoreset::NextStep => self.waiting |= 1 << lane,
                Autoreset::Disabled => {}
                Autoreset::SameStep => {
                    let draft = self.pack.draw(lane, None, &Overrides::new());
                    match draft.and_then(|draft| self.pack.begin(lane, &draft)) {
                        Ok(()) => {
                            self.pack.write_observation(lane, &mut rows);
                            self.running |= 1 << lane;
                            self.began |= 1 << lane;
                        }
                        // the other lanes go on
                        Err(error) => failure = Err(error),
                    }
                }
            }
        }
        failure
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
