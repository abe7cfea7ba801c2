//! An environment as bytes.

use crate::config::distribution::{Distribution, Setting};
use crate::config::parameter::{COUNT, Overrides};
use crate::config::scenario::{Scenario, ValidScenario};
use crate::env::episode::{Member, Phase};
use crate::env::observation::{OBSERVATION_LIMIT, frame_now, told_payload};
use crate::env::pack::EnvPack;
use crate::error::{ConfigError, Error, SnapshotError};
use crate::math::rng::{Purpose, Seed, Stream};
use crate::simulation::course::Course;
use crate::simulation::{Flight, FlightState, Plan};
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Everything in an [`Env`] that changes.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Saved {
    pub(super) seed: Seed,
    pub(super) episode: u64,
    pub(super) phase: Phase,
    /// Position, number or none, name: the compact format cannot tell a number from a name. In the
    /// place of a name, a distribution that is drawn from as JSON text, which begins with a brace.
    pub(super) persistent: Vec<(usize, Option<f64>, String)>,
    pub(super) scenario: Scenario,
    pub(super) flight: FlightState,
    pub(super) steps: f64,
    pub(super) action: [f64; 3],
    pub(super) terms: [f64; 3],
    pub(super) episode_return: f64,
    pub(super) diverged: bool,
    pub(super) observation: Vec<f32>,
}

const SNAPSHOT_MAGIC: &[u8; 4] = b"DRMe";

const SNAPSHOT_VERSION: u16 = 6;

/// Magic, version, fingerprint of the configuration, checksum of what follows.
const SNAPSHOT_HEADER: usize = 4 + 2 + 8 + 4;

impl EnvPack<f64> {
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
        let mut body = postcard::to_allocvec(&saved).unwrap_or_default();
        if let Some(course) = self.course_of(0) {
            // behind the rest, so that snapshots of manoeuvres are as they were
            body.extend(postcard::to_allocvec(course.state()).unwrap_or_default());
        }
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
        let (saved, rest) = postcard::take_from_bytes::<Saved>(body).map_err(|e| damaged(&e))?;
        self.check_saved(&saved).map_err(|e| damaged(&e))?;
        let persistent = self.overrides_of(&saved).map_err(|e| damaged(&e))?;
        let scenario = ValidScenario::new(saved.scenario).map_err(|e| damaged(&e))?;
        let noise = Stream::new(saved.seed, saved.episode, Purpose::Sensors);
        let config = &self.setup.config;
        let (mut flight, course) = match config.mission_of(scenario).map_err(|e| damaged(&e))? {
            None => {
                let plan = Plan::new(scenario).map_err(|e| damaged(&e))?;
                (Flight::new(plan, noise).map_err(|e| damaged(&e))?, None)
            }
            Some(mission) => {
                let state = postcard::from_bytes(rest).map_err(|e| damaged(&e))?;
                let (flight, course) = Course::restored(mission, state, noise)?;
                (flight, Some(Box::new(course)))
            }
        };
        let told = told_payload(&flight.scenario(), &self.config().task);
        let payload = told.map_err(|e| damaged(&e))?;
        flight.set_state(saved.flight, saved.diverged)?;
        let fresh = saved.phase == Phase::Fresh;
        let seen = fresh || self.shows(&saved.observation, &flight, &payload);
        // after the last leg the flight still shows the end of it
        let done = course.as_ref().is_some_and(|course| course.is_done());
        let before = course.as_ref().map_or(0, |course| course.before()) as f64;
        let flown = if done {
            before
        } else {
            before + flight.common.sample
        };
        if !(seen && self.reaches(saved.phase, saved.steps, saved.diverged, flown, done)) {
            return Err(damaged(&"its parts do not belong together").into());
        }
        self.flight = flight;
        self.payload = payload;
        self.members[0] = Member {
            seed: saved.seed,
            episode: saved.episode,
            phase: saved.phase,
            persistent,
            course,
        };
        self.steps = saved.steps;
        self.before = before;
        self.action = saved.action;
        self.terms = saved.terms;
        self.episode_return = saved.episode_return;
        self.diverged = u32::from(saved.diverged);
        self.observations = saved.observation;
        Ok(())
    }

    /// Refuses a snapshot with values that no environment of this configuration has.
    pub(super) fn check_saved(&self, saved: &Saved) -> Result<(), &'static str> {
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
    pub(super) fn overrides_of(&self, saved: &Saved) -> Result<Overrides, ConfigError> {
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
    pub(super) fn shows(&self, observation: &[f32], flight: &Flight, payload: &[f64; 3]) -> bool {
        let frame = frame_now(flight, self.config(), payload);
        // of a void state nothing is shown
        flight.void() != 0 || observation.ends_with(&frame)
    }

    /// Whether an episode is in this phase after so many steps and samples; `done` says that its mission
    /// is complete.
    pub(super) fn reaches(
        &self,
        phase: Phase,
        steps: f64,
        diverged: bool,
        sample: f64,
        done: bool,
    ) -> bool {
        let (each, horizon) = (self.setup.samples_per_action, self.setup.horizon as f64);
        let cut = self.setup.cut as f64;
        let begun = (sample / each as f64).ceil();
        let course = match phase {
            Phase::Fresh => sample == 0.0 && !diverged,
            Phase::Running => {
                !done && sample < horizon && steps * each as f64 == sample && !diverged
            }
            Phase::Ended => done || sample == horizon || sample == cut || sample > 0.0 && diverged,
        };
        course && steps == begun && sample <= horizon
    }
}
