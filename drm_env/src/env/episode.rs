//! Where an environment is in its life, and what may be done to it there.

use crate::config::parameter::Overrides;
use crate::config::scenario::ValidScenario;
use crate::error::SimulationError;
use crate::math::rng::Seed;
use crate::simulation::course::Course;
use serde::{Deserialize, Serialize};

/// Where an environment is in its life.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Phase {
    Fresh,
    Running,
    Ended,
}

/// What one environment has beside its flight.
#[derive(Debug, Clone)]
pub(crate) struct Member {
    pub(crate) seed: Seed,
    pub(crate) episode: u64,
    pub(crate) phase: Phase,
    /// Overrides of what is drawn, in every episode.
    pub(crate) persistent: Overrides,
    /// The mission under way, where episodes are missions.
    pub(crate) course: Option<Box<Course>>,
}

/// An episode about to begin.
#[derive(Debug, Clone)]
pub(crate) struct Draft {
    pub(crate) seed: Seed,
    pub(crate) episode: u64,
    pub(crate) scenario: ValidScenario,
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
