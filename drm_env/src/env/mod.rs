//! One environment: episodes drawn from a configuration, stepped by actions, with exact snapshots.

pub(crate) mod agent;
pub(crate) mod any_pack;
pub(crate) mod episode;
pub mod observation;
pub(crate) mod pack;
pub mod reward;
pub(crate) mod setup;
mod snapshot;
pub(crate) mod termination;

use std::sync::Arc;

use crate::config::parameter::{COUNT, Overrides};
use crate::config::scenario::Scenario;
use crate::config::{EnvConfig, ValidConfig, context};
use crate::env::episode::{Member, Phase, check_finite, check_phase};
use crate::env::pack::EnvPack;
use crate::env::setup::Setup;
use crate::error::{ConfigError, SimulationError};
use crate::interruption;
use crate::math::rng::{Purpose, Seed, Stream};
use crate::simulation::course::Course;
use crate::simulation::metrics::Metrics;
use crate::simulation::{Flight, LegRecord, Plan};

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

/// Instants of each leg on the path of a mission.
const INSTANTS_OF_PATH: usize = 60;

/// One environment.
pub type Env = EnvPack<f64>;

impl EnvPack<f64> {
    /// An environment that has not been reset yet.
    ///
    /// # Errors
    /// A configuration that cannot be flown.
    pub fn new(
        config: impl TryInto<ValidConfig, Error: Into<ConfigError>>,
    ) -> Result<Self, ConfigError> {
        Self::with_setup(Setup::new(&config.try_into().map_err(Into::into)?))
    }

    pub(crate) fn with_setup(setup: Arc<Setup>) -> Result<Self, ConfigError> {
        let seed = Seed::default();
        let scenario = setup.config.draw(seed, 0, &[])?;
        let noise = Stream::new(seed, 0, Purpose::Sensors);
        let (flight, course) = match setup.config.mission_of(scenario)? {
            None => (Flight::new(Plan::new(scenario)?, noise)?, None),
            Some(mission) => {
                let (flight, course) = Course::begin(mission, noise)?;
                (flight, Some(Box::new(course)))
            }
        };
        Ok(Self {
            observations: vec![0.0; setup.observation_size],
            setup,
            members: vec![Member {
                seed,
                episode: 0,
                phase: Phase::Fresh,
                persistent: Overrides::new(),
                course,
            }],
            flight,
            payload: [0.0; 3],
            steps: 0.0,
            before: 0.0,
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

    /// Sum of the rewards of this episode so far.
    pub fn episode_return(&self) -> f64 {
        self.episode_return
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
        if let Some(course) = self.course_of(0) {
            return course.metrics(&self.flight, self.diverged());
        }
        self.flight.metrics(self.diverged(), self.episode_return)
    }

    /// Metrics of the episode so far; while it is under way without the energy that is left, which
    /// is NaN.
    pub fn progress(&self) -> Metrics {
        if self.is_running() {
            if let Some(course) = self.course_of(0) {
                return course.metrics_under_way(&self.flight, self.diverged());
            }
            return self
                .flight
                .metrics_under_way(self.diverged(), self.episode_return);
        }
        self.metrics()
    }

    /// The true context, in the order of [`crate::config::parameter::PARAMETERS`].
    pub fn context(&self) -> [f64; COUNT] {
        context(&self.scenario())
    }

    /// The manoeuvre of this episode, or what all legs of its mission have in common.
    pub fn scenario(&self) -> Scenario {
        self.course_of(0).map_or_else(
            || self.flight.scenario(),
            |course| *course.mission().scenario(),
        )
    }

    /// Legs of the mission flown in this episode, and the one under way; none of a manoeuvre.
    pub fn legs(&self) -> Vec<LegRecord> {
        let course = self.course_of(0);
        course.map_or_else(Vec::new, |course| {
            course.records(&self.flight, self.diverged())
        })
    }

    /// Place of the leg under way in the mission's list, and the sums of the reward's terms of every leg
    /// that takes time, three a leg; nothing of a manoeuvre.
    pub fn mission_report(&self) -> Vec<f64> {
        self.course_of(0).map_or_else(Vec::new, Course::report)
    }

    /// Angle (rad) at which the mission ends, and angle and extension (m) on the way; none of a manoeuvre.
    pub fn mission_path(&self) -> Option<(f64, Vec<(f64, f64)>)> {
        self.course_of(0)
            .map(|course| course.path(INSTANTS_OF_PATH))
    }

    /// Place of the leg under way in the mission's list, and time (s) and reference of the slew angle
    /// (rad) at its beginning; zeros of a manoeuvre.
    pub fn leg(&self) -> (usize, f64, f64) {
        self.course_of(0).map_or((0, 0.0, 0.0), |course| {
            let origin = course.origin(self.flight.sample_period());
            (course.leg(), origin.time, origin.angle)
        })
    }

    /// The flight of this episode.
    pub fn flight(&self) -> &Flight {
        &self.flight
    }
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
            config.draw(seed, 0, &[]).map(Scenario::from)
        })
        .collect()
}
