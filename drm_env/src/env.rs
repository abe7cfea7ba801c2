//! One environment: episodes drawn from a configuration, stepped by actions, with exact snapshots.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::config::{Actuator, EnvConfig, context};
use crate::control::WheelTorques;
use crate::distribution::Setting;
use crate::error::{ConfigError, Error, SimulationError, SnapshotError};
use crate::flight::{Flight, FlightState, Plan};
use crate::metrics::Metrics;
use crate::parameter::{COUNT, Overrides};
use crate::rng::{Purpose, Seed, Stream};
use crate::scenario::Scenario;
use crate::task::{RewardSums, charge_for_rest, frame_size, is_lost, observation_size, observe};

/// What a step returns besides the observation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// Sum of the reward's terms.
    pub reward: f64,
    /// The episode ended by divergence or at a limit of the structure.
    pub terminated: bool,
    /// The episode reached its horizon.
    pub truncated: bool,
}

/// Where an environment is in its life.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
enum Phase {
    Fresh,
    Running,
    Ended,
}

/// One environment.
#[derive(Debug, Clone)]
pub struct Env {
    config: Arc<EnvConfig>,
    fingerprint: u64,
    seed: Seed,
    episode: u64,
    phase: Phase,
    persistent: Overrides,
    flight: Flight,
    steps: u64,
    action: [f64; 3],
    terms: [f64; 3],
    episode_return: f64,
    diverged: bool,
    observation: Vec<f32>,
    frame: Vec<f32>,
}

/// Everything in an [`Env`] that changes.
#[derive(Debug, Serialize, Deserialize)]
struct Saved {
    seed: Seed,
    episode: u64,
    phase: Phase,
    /// Position, number or none, name: the compact format cannot tell a number from a name.
    persistent: Vec<(usize, Option<f64>, String)>,
    scenario: Scenario,
    flight: FlightState,
    steps: u64,
    action: [f64; 3],
    terms: [f64; 3],
    episode_return: f64,
    diverged: bool,
    observation: Vec<f32>,
}

const SNAPSHOT_MAGIC: &[u8; 4] = b"DRMe";
const SNAPSHOT_VERSION: u16 = 1;
/// Magic, version, fingerprint of the configuration, checksum of what follows.
const SNAPSHOT_HEADER: usize = 4 + 2 + 8 + 4;

impl Env {
    /// An environment that has not been reset yet.
    ///
    /// # Errors
    /// A configuration that cannot be flown.
    pub fn new(config: Arc<EnvConfig>) -> Result<Self, ConfigError> {
        config.validate()?;
        let seed = Seed::default();
        let scenario = config.draw(seed, 0, &[])?;
        let flight = Flight::new(
            Plan::new(&scenario)?,
            Stream::new(seed, 0, Purpose::Sensors),
        );
        Ok(Self {
            fingerprint: fingerprint(&config),
            observation: vec![0.0; observation_size(&config)],
            frame: Vec::with_capacity(frame_size(&config.task)),
            config,
            seed,
            episode: 0,
            phase: Phase::Fresh,
            persistent: Overrides::new(),
            flight,
            steps: 0,
            action: [0.0; 3],
            terms: [0.0; 3],
            episode_return: 0.0,
            diverged: false,
        })
    }

    /// The configuration.
    pub fn config(&self) -> &EnvConfig {
        &self.config
    }

    /// Begins an episode: the first of a seed, or the next one without. `once` overrides what is
    /// drawn, for this episode alone.
    ///
    /// # Errors
    /// A scenario that cannot be flown; nothing has changed then.
    pub fn reset(&mut self, seed: Option<Seed>, once: &Overrides) -> Result<(), ConfigError> {
        let (seed, episode) = match (seed, self.phase) {
            (Some(seed), _) => (seed, 0),
            (None, Phase::Fresh) => (self.seed, 0),
            (None, _) => (self.seed, self.episode + 1),
        };
        let scenario = self.config.draw(seed, episode, &[&self.persistent, once])?;
        let plan = Plan::new(&scenario)?;
        self.flight = Flight::new(plan, Stream::new(seed, episode, Purpose::Sensors));
        self.seed = seed;
        self.episode = episode;
        self.phase = Phase::Running;
        self.steps = 0;
        self.action = [0.0; 3];
        self.terms = [0.0; 3];
        self.episode_return = 0.0;
        self.diverged = false;
        observe(&self.flight, &self.config.task, &mut self.frame);
        for slot in self.observation.chunks_exact_mut(self.frame.len()) {
            slot.copy_from_slice(&self.frame);
        }
        Ok(())
    }

    /// Overrides what is drawn in every episode from the next on, until called again.
    ///
    /// # Errors
    /// Settings with which the configuration cannot be flown; nothing has changed then.
    pub fn set_context(&mut self, settings: Overrides) -> Result<(), ConfigError> {
        self.config.draw(self.seed, self.episode, &[&settings])?;
        self.persistent = settings;
        Ok(())
    }

    /// Refuses an action of the wrong size or with entries that are not finite.
    pub fn check_action(&self, action: &[f32]) -> Result<(), SimulationError> {
        let expected = self.config.task.actuators.len();
        if action.len() != expected {
            return Err(SimulationError::ActionSize {
                expected,
                got: action.len(),
            });
        }
        check_finite(action)
    }

    /// Refuses a step before the first reset or after the end of an episode.
    pub fn check_running(&self) -> Result<(), SimulationError> {
        match self.phase {
            Phase::Running => Ok(()),
            Phase::Fresh => Err(SimulationError::NotRunning("call reset before step")),
            Phase::Ended => Err(SimulationError::NotRunning(
                "the episode has ended, call reset before step",
            )),
        }
    }

    /// One control period under an action; entries beyond -1..=1 are limited to it.
    ///
    /// # Errors
    /// See [`Env::check_action`] and [`Env::check_running`]; nothing has changed then.
    pub fn step(&mut self, action: &[f32]) -> Result<Outcome, SimulationError> {
        self.check_running()?;
        self.check_action(action)?;
        Ok(self.step_checked(action))
    }

    /// [`Env::step`] of a running environment with an action known to be good.
    pub(crate) fn step_checked(&mut self, action: &[f32]) -> Outcome {
        let config = Arc::clone(&self.config);
        let task = &config.task;
        let change = task
            .action_rate_limit
            .map_or(f64::INFINITY, |limit| limit * task.control_period);
        for (held, &wanted) in self.action.iter_mut().zip(action) {
            let wanted = f64::from(wanted).clamp(-1.0, 1.0);
            *held = wanted.clamp(*held - change, *held + change);
        }
        let scenario = &self.flight.plan().scenario;
        let (mut root, mut tip, mut slew) = (0.0, 0.0, None);
        for (actuator, fraction) in task.actuators.iter().zip(self.action) {
            match actuator {
                Actuator::RootWheel => root = fraction * scenario.root_wheel.torque_limit,
                Actuator::TipWheel => tip = fraction * scenario.tip_wheel.torque_limit,
                Actuator::SlewMotor => slew = Some(fraction * scenario.slew_motor.torque_limit),
            }
        }
        let (horizon, period) = (scenario.samples() as u64, scenario.sample_period);
        let left = horizon.saturating_sub(self.flight.sample());
        let samples = (config.samples_per_action() as u64).min(left);
        let mut sums = RewardSums::default();
        let mut flown = 0;
        for _ in 0..samples {
            let mut command = WheelTorques { root, tip };
            if let Some(law) = &task.inner_law {
                let below = self.flight.law_torques(law);
                command.root += below.root;
                command.tip += below.tip;
            }
            self.flight.advance(&command, slew);
            flown += 1;
            if is_lost(&self.flight, task) {
                self.diverged = true;
                break;
            }
            sums.take(&self.flight, &task.reward);
        }
        self.steps += 1;
        let mut terms = sums.terms(&task.reward, flown as f64 * period);
        if self.diverged {
            let reach =
                self.flight.plan().scenario.arm.link1.length + self.flight.extension().length;
            let rest = (left - flown) as f64 * period;
            let [vibration, slew] = charge_for_rest(task, reach, rest);
            terms[0] += vibration;
            terms[1] += slew;
        }
        self.terms = terms;
        let reward: f64 = terms.iter().sum();
        self.episode_return += reward;
        // a state that is not finite is not observed: the last finite observation stays
        if self.flight.is_finite() {
            observe(&self.flight, task, &mut self.frame);
            let frame = self.frame.len();
            self.observation.copy_within(frame.., 0);
            let newest = self.observation.len() - frame;
            self.observation[newest..].copy_from_slice(&self.frame);
        }
        let truncated = !self.diverged && self.flight.sample() >= horizon;
        if self.diverged || truncated {
            self.phase = Phase::Ended;
        }
        Outcome {
            reward,
            terminated: self.diverged,
            truncated,
        }
    }

    /// The observation, scaled, oldest frame first.
    pub fn observation(&self) -> &[f32] {
        &self.observation
    }

    /// The reward's terms of the last step.
    pub fn reward_terms(&self) -> [f64; 3] {
        self.terms
    }

    /// Actions taken in this episode.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Whether the episode ended by divergence or at a limit of the structure.
    pub fn diverged(&self) -> bool {
        self.diverged
    }

    /// Whether an episode is under way.
    pub fn is_running(&self) -> bool {
        self.phase == Phase::Running
    }

    /// Whether there has been an episode at all.
    pub fn has_reset(&self) -> bool {
        self.phase != Phase::Fresh
    }

    /// Metrics of the episode so far.
    pub fn metrics(&self) -> Metrics {
        self.flight.metrics(self.diverged, self.episode_return)
    }

    /// The true context, in the order of [`crate::parameter::PARAMETERS`].
    pub fn context(&self) -> [f64; COUNT] {
        context(&self.flight.plan().scenario)
    }

    /// The manoeuvre of this episode.
    pub fn scenario(&self) -> &Scenario {
        &self.flight.plan().scenario
    }

    /// The flight of this episode.
    pub fn flight(&self) -> &Flight {
        &self.flight
    }

    /// Everything that changes, as bytes that [`Env::set_state`] restores exactly.
    pub fn get_state(&self) -> Vec<u8> {
        let saved = Saved {
            seed: self.seed,
            episode: self.episode,
            phase: self.phase,
            persistent: self
                .persistent
                .iter()
                .map(|(index, setting)| match setting {
                    Setting::Number(value) => (*index, Some(*value), String::new()),
                    Setting::Name(name) => (*index, None, name.clone()),
                })
                .collect(),
            scenario: *self.scenario(),
            flight: self.flight.state().clone(),
            steps: self.steps,
            action: self.action,
            terms: self.terms,
            episode_return: self.episode_return,
            diverged: self.diverged,
            observation: self.observation.clone(),
        };
        // plain numbers and lists always serialise
        let body = postcard::to_allocvec(&saved).unwrap_or_default();
        let mut bytes = Vec::with_capacity(SNAPSHOT_HEADER + body.len());
        bytes.extend_from_slice(SNAPSHOT_MAGIC);
        bytes.extend_from_slice(&SNAPSHOT_VERSION.to_le_bytes());
        bytes.extend_from_slice(&self.fingerprint.to_le_bytes());
        bytes.extend_from_slice(&crc32fast::hash(&body).to_le_bytes());
        bytes.extend_from_slice(&body);
        bytes
    }

    /// Restores what [`Env::get_state`] returned, here or in another process.
    ///
    /// # Errors
    /// Damaged or foreign data; nothing has changed then.
    pub fn set_state(&mut self, bytes: &[u8]) -> Result<(), Error> {
        let (magic, rest) = bytes
            .split_first_chunk::<4>()
            .ok_or(SnapshotError::Foreign)?;
        if magic != SNAPSHOT_MAGIC {
            return Err(SnapshotError::Foreign.into());
        }
        let short = || SnapshotError::Damaged("it is too short".into());
        let (version, rest) = rest.split_first_chunk::<2>().ok_or_else(short)?;
        let found = u16::from_le_bytes(*version);
        if found != SNAPSHOT_VERSION {
            return Err(SnapshotError::Version {
                found,
                expected: SNAPSHOT_VERSION,
            }
            .into());
        }
        let (mark, rest) = rest.split_first_chunk::<8>().ok_or_else(short)?;
        let (checksum, body) = rest.split_first_chunk::<4>().ok_or_else(short)?;
        if crc32fast::hash(body) != u32::from_le_bytes(*checksum) {
            return Err(SnapshotError::Damaged("the checksum does not fit".into()).into());
        }
        if u64::from_le_bytes(*mark) != self.fingerprint {
            return Err(SnapshotError::OtherConfiguration.into());
        }
        let damaged = |what: &dyn std::fmt::Display| SnapshotError::Damaged(what.to_string());
        let saved: Saved = postcard::from_bytes(body).map_err(|e| damaged(&e))?;
        if saved.observation.len() != self.observation.len() {
            return Err(damaged(&"the observation has another length").into());
        }
        if saved.persistent.iter().any(|(index, ..)| *index >= COUNT) {
            return Err(damaged(&"it names an unknown parameter").into());
        }
        let plan = Plan::new(&saved.scenario).map_err(|e| damaged(&e))?;
        let mut flight = Flight::new(plan, Stream::new(saved.seed, 0, Purpose::Sensors));
        flight.set_state(saved.flight)?;
        self.flight = flight;
        self.seed = saved.seed;
        self.episode = saved.episode;
        self.phase = saved.phase;
        self.persistent = saved
            .persistent
            .into_iter()
            .map(|(index, number, name)| {
                (index, number.map_or(Setting::Name(name), Setting::Number))
            })
            .collect();
        self.steps = saved.steps;
        self.action = saved.action;
        self.terms = saved.terms;
        self.episode_return = saved.episode_return;
        self.diverged = saved.diverged;
        self.observation = saved.observation;
        Ok(())
    }
}

/// Refuses entries that are not finite.
pub(crate) fn check_finite(action: &[f32]) -> Result<(), SimulationError> {
    match action.iter().position(|value| !value.is_finite()) {
        None => Ok(()),
        Some(index) => Err(SimulationError::ActionNotFinite {
            index,
            value: f64::from(action[index]),
        }),
    }
}

/// A mark of the configuration: two environments with the same mark exchange snapshots.
fn fingerprint(config: &EnvConfig) -> u64 {
    let text = config.to_json();
    let reversed: Vec<u8> = text.bytes().rev().collect();
    u64::from(crc32fast::hash(text.as_bytes())) << 32 | u64::from(crc32fast::hash(&reversed))
}

/// The scenarios that environments with this configuration and the seeds `seed`, `seed + 1`, ...
/// (little-endian bytes of each) fly in their first episode.
///
/// # Errors
/// A draw that cannot be flown.
pub fn sample_scenarios(config: &EnvConfig, seeds: &[Seed]) -> Result<Vec<Scenario>, ConfigError> {
    seeds
        .iter()
        .map(|&seed| config.draw(seed, 0, &[]))
        .collect()
}
