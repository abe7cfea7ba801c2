//! One environment: episodes drawn from a configuration, stepped by actions, with exact snapshots.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::cohort::{Cohort, Member, Phase, Setup};
use crate::config::{EnvConfig, context};
use crate::distribution::{Distribution, Setting};
use crate::error::{ConfigError, Error, SimulationError, SnapshotError};
use crate::flight::{Flight, FlightState, Plan};
use crate::interruption;
use crate::metrics::Metrics;
use crate::parameter::{COUNT, Overrides};
use crate::rng::{Purpose, Seed, Stream};
use crate::scenario::Scenario;
use crate::task::{OBSERVATION_LIMIT, frame_now, told_payload};

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

/// One environment.
pub type Env = Cohort<f64>;

/// Everything in an [`Env`] that changes.
#[derive(Debug, Serialize, Deserialize)]
struct Saved {
    seed: Seed,
    episode: u64,
    phase: Phase,
    /// Position, number or none, name: the compact format cannot tell a number from a name. In the
    /// place of a name, a distribution that is drawn from as JSON text, which begins with a brace.
    persistent: Vec<(usize, Option<f64>, String)>,
    scenario: Scenario,
    flight: FlightState,
    steps: f64,
    action: [f64; 3],
    terms: [f64; 3],
    episode_return: f64,
    diverged: bool,
    observation: Vec<f32>,
}

const SNAPSHOT_MAGIC: &[u8; 4] = b"DRMe";
const SNAPSHOT_VERSION: u16 = 2;
/// Magic, version, fingerprint of the configuration, checksum of what follows.
const SNAPSHOT_HEADER: usize = 4 + 2 + 8 + 4;

impl Cohort<f64> {
    /// An environment that has not been reset yet.
    ///
    /// # Errors
    /// A configuration that cannot be flown.
    pub fn new(config: Arc<EnvConfig>) -> Result<Self, ConfigError> {
        Self::with_setup(Setup::new(&config)?)
    }

    pub(crate) fn with_setup(setup: Arc<Setup>) -> Result<Self, ConfigError> {
        let seed = Seed::default();
        let scenario = setup.config.draw(seed, 0, &[])?;
        let noise = Stream::new(seed, 0, Purpose::Sensors);
        Ok(Self {
            observations: vec![0.0; setup.observation_size],
            setup,
            members: vec![Member {
                seed,
                episode: 0,
                phase: Phase::Fresh,
                persistent: Overrides::new(),
            }],
            flight: Flight::new(Plan::of_valid(&scenario)?, noise)?,
            payload: [0.0; 3],
            steps: 0.0,
            action: [0.0; 3],
            terms: [0.0; 3],
            episode_return: 0.0,
            diverged: 0,
        })
    }

    /// The configuration.
    pub fn config(&self) -> &EnvConfig {
        &self.setup.config
    }

    /// Begins an episode: the first of a seed, or the next one without. `once` overrides what is
    /// drawn, for this episode alone.
    ///
    /// # Errors
    /// A scenario that cannot be flown; nothing has changed then.
    pub fn reset(&mut self, seed: Option<Seed>, once: &Overrides) -> Result<(), ConfigError> {
        let draft = self.draw(0, seed, once)?;
        self.begin(0, &draft)
    }

    /// Overrides what is drawn in every episode from the next on, until called again.
    ///
    /// # Errors
    /// Settings with which the configuration cannot be flown; nothing has changed then.
    pub fn set_context(&mut self, settings: Overrides) -> Result<(), ConfigError> {
        self.check_context(0, &settings)?;
        self.set_lane_context(0, settings);
        Ok(())
    }

    /// Refuses an action of the wrong size or with entries that are not finite.
    pub fn check_action(&self, action: &[f32]) -> Result<(), SimulationError> {
        let expected = self.config().task.actuators.len();
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
        check_phase(self.members[0].phase)
    }

    /// One control period under an action; entries beyond -1..=1 are limited to it.
    ///
    /// # Errors
    /// See [`Env::check_action`] and [`Env::check_running`]; nothing has changed then.
    pub fn step(&mut self, action: &[f32]) -> Result<Outcome, SimulationError> {
        self.check_running()?;
        self.check_action(action)?;
        let outcomes = self.step_lanes(action, 1);
        Ok(Outcome {
            reward: outcomes.reward,
            terminated: outcomes.terminated != 0,
            truncated: outcomes.truncated != 0,
        })
    }

    /// The observation, scaled, oldest frame first.
    pub fn observation(&self) -> &[f32] {
        &self.observations
    }

    /// The reward's terms of the last step.
    pub fn reward_terms(&self) -> [f64; 3] {
        self.terms
    }

    /// Actions taken in this episode.
    pub fn steps(&self) -> u64 {
        self.steps as u64
    }

    /// Whether the episode ended by divergence or at a limit of the structure.
    pub fn diverged(&self) -> bool {
        self.diverged != 0
    }

    /// Whether an episode is under way.
    pub fn is_running(&self) -> bool {
        self.members[0].phase == Phase::Running
    }

    /// Whether there has been an episode at all.
    pub fn has_reset(&self) -> bool {
        self.members[0].phase != Phase::Fresh
    }

    /// Metrics of the episode so far.
    pub fn metrics(&self) -> Metrics {
        self.flight.metrics(self.diverged(), self.episode_return)
    }

    /// Metrics of the episode so far; while it is under way without the energy that is left, which
    /// is NaN.
    pub fn progress(&self) -> Metrics {
        if self.is_running() {
            return self
                .flight
                .metrics_under_way(self.diverged(), self.episode_return);
        }
        self.metrics()
    }

    /// The true context, in the order of [`crate::parameter::PARAMETERS`].
    pub fn context(&self) -> [f64; COUNT] {
        context(&self.scenario())
    }

    /// The manoeuvre of this episode.
    pub fn scenario(&self) -> Scenario {
        self.flight.scenario()
    }

    /// The flight of this episode.
    pub fn flight(&self) -> &Flight {
        &self.flight
    }

    /// Everything that changes, as bytes that [`Env::set_state`] restores exactly.
    pub fn get_state(&self) -> Vec<u8> {
        let saved = Saved {
            seed: self.members[0].seed,
            episode: self.members[0].episode,
            phase: self.members[0].phase,
            persistent: self.members[0]
                .persistent
                .iter()
                .map(|(index, setting)| match setting {
                    Distribution::Fixed(Setting::Number(value)) => {
                        (*index, Some(*value), String::new())
                    }
                    Distribution::Fixed(Setting::Name(name)) => (*index, None, name.clone()),
                    drawn => (*index, None, Value::from(drawn.clone()).to_string()),
                })
                .collect(),
            scenario: self.scenario(),
            flight: self.flight.state(),
            steps: self.steps,
            action: self.action,
            terms: self.terms,
            episode_return: self.episode_return,
            diverged: self.diverged(),
            observation: self.observations.clone(),
        };
        // plain numbers and lists always serialise
        let body = postcard::to_allocvec(&saved).unwrap_or_default();
        let mut bytes = Vec::with_capacity(SNAPSHOT_HEADER + body.len());
        bytes.extend_from_slice(SNAPSHOT_MAGIC);
        bytes.extend_from_slice(&SNAPSHOT_VERSION.to_le_bytes());
        bytes.extend_from_slice(&self.setup.fingerprint.to_le_bytes());
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
        if u64::from_le_bytes(*mark) != self.setup.fingerprint {
            return Err(SnapshotError::OtherConfiguration.into());
        }
        let damaged = |what: &dyn std::fmt::Display| SnapshotError::Damaged(what.to_string());
        let saved: Saved = postcard::from_bytes(body).map_err(|e| damaged(&e))?;
        self.check_saved(&saved).map_err(|e| damaged(&e))?;
        let persistent = self.overrides_of(&saved).map_err(|e| damaged(&e))?;
        let plan = Plan::new(&saved.scenario).map_err(|e| damaged(&e))?;
        let payload =
            told_payload(&saved.scenario, &self.config().task).map_err(|e| damaged(&e))?;
        let noise = Stream::new(saved.seed, saved.episode, Purpose::Sensors);
        let mut flight = Flight::new(plan, noise).map_err(|e| damaged(&e))?;
        flight.set_state(saved.flight, saved.diverged)?;
        let fresh = saved.phase == Phase::Fresh;
        let seen = fresh || self.shows(&saved.observation, &flight, &payload);
        if !(seen && self.reaches(saved.phase, saved.steps, saved.diverged, &flight)) {
            return Err(damaged(&"its parts do not belong together").into());
        }
        self.flight = flight;
        self.payload = payload;
        self.members[0] = Member {
            seed: saved.seed,
            episode: saved.episode,
            phase: saved.phase,
            persistent,
        };
        self.steps = saved.steps;
        self.action = saved.action;
        self.terms = saved.terms;
        self.episode_return = saved.episode_return;
        self.diverged = u32::from(saved.diverged);
        self.observations = saved.observation;
        Ok(())
    }

    /// Refuses a snapshot with values that no environment of this configuration has.
    fn check_saved(&self, saved: &Saved) -> Result<(), &'static str> {
        let task = &self.config().task;
        let limit = OBSERVATION_LIMIT as f32;
        if saved.observation.len() != self.observations.len() {
            return Err("the observation has another length");
        }
        if !saved.observation.iter().all(|x| x.abs() <= limit) {
            return Err("its observation is none");
        }
        if saved.scenario.common_part() != self.config().scenario.common_part() {
            return Err("it holds a manoeuvre of another configuration");
        }
        if saved.episode == u64::MAX {
            return Err("it has no next episode");
        }
        let (driven, idle) = saved.action.split_at(task.actuators.len());
        if !driven.iter().all(|x| x.abs() <= 1.0) || idle.iter().any(|x| *x != 0.0) {
            return Err("its action is none");
        }
        let mut paid = saved.terms.iter().chain([&saved.episode_return]);
        if !paid.all(|x| x.is_finite() && *x <= 0.0) {
            return Err("its reward is none");
        }
        Ok(())
    }

    /// What a snapshot overrides in every episode.
    fn overrides_of(&self, saved: &Saved) -> Result<Overrides, ConfigError> {
        let wrong = |what: &str| Err(ConfigError::form("context", what));
        let mut overrides = Overrides::with_capacity(saved.persistent.len().min(COUNT));
        for (index, number, name) in &saved.persistent {
            if *index >= COUNT || overrides.iter().any(|(other, _)| other == index) {
                return wrong("it names an unknown parameter, or one twice");
            }
            let drawn = match number {
                Some(number) => Distribution::Fixed(Setting::Number(*number)),
                None if name.starts_with('{') => serde_json::from_str(name)
                    .map_err(|error| ConfigError::form("context", error))?,
                None => Distribution::Fixed(Setting::Name(name.clone())),
            };
            overrides.push((*index, drawn));
        }
        let config = self.config();
        config.check_overrides(saved.seed, saved.episode, &overrides)?;
        Ok(overrides)
    }

    /// Whether an observation shows a flight.
    fn shows(&self, observation: &[f32], flight: &Flight, payload: &[f64; 3]) -> bool {
        let frame = frame_now(flight, &self.config().task, payload);
        // of a void state nothing is shown
        flight.void() != 0 || observation.ends_with(&frame)
    }

    /// Whether an episode is in this phase after so many steps and the samples of the flight.
    fn reaches(&self, phase: Phase, steps: f64, diverged: bool, flight: &Flight) -> bool {
        let (each, horizon) = (self.setup.samples_per_action, self.setup.horizon as f64);
        let cut = self.setup.cut as f64;
        let sample = flight.common.sample;
        let begun = (sample / each as f64).ceil();
        let course = match phase {
            Phase::Fresh => sample == 0.0 && !diverged,
            Phase::Running => sample < horizon && steps * each as f64 == sample && !diverged,
            Phase::Ended => sample == horizon || sample == cut || sample > 0.0 && diverged,
        };
        course && steps == begun && sample <= horizon
    }
}

/// Refuses a step of an environment that is not running.
pub(crate) fn check_phase(phase: Phase) -> Result<(), SimulationError> {
    match phase {
        Phase::Running => Ok(()),
        Phase::Fresh => Err(SimulationError::NotRunning("call reset before step")),
        Phase::Ended => Err(SimulationError::NotRunning(
            "the episode has ended, call reset before step",
        )),
    }
}

/// Refuses entries that are not finite.
pub(crate) fn check_finite(action: &[f32]) -> Result<(), SimulationError> {
    // without a way out in between it goes in registers
    if action
        .iter()
        .fold(true, |all, value| all & value.is_finite())
    {
        return Ok(());
    }
    match action.iter().position(|value| !value.is_finite()) {
        None => Ok(()),
        Some(index) => Err(SimulationError::ActionNotFinite {
            index,
            value: f64::from(action[index]),
        }),
    }
}

/// A mark of the configuration: two environments with the same mark exchange snapshots.
pub(crate) fn fingerprint(config: &EnvConfig) -> u64 {
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
        .map(|&seed| {
            interruption::poll();
            config.draw(seed, 0, &[])
        })
        .collect()
}
