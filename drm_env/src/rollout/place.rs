//! A manoeuvre or a mission in one lane: how it begins, goes on and ends.

use crate::config::mission::ValidMission;
use crate::config::scenario::ValidScenario;
use crate::error::ConfigError;
use crate::math::rng::Seed;
use crate::simd::Number;
use crate::simulation::course::{Course, Turn};
use crate::simulation::metrics::Metrics;
use crate::simulation::{Flight, LegRecord, Plan};

use super::noise;
use super::recorder::{Kept, Recorder};

/// What is known of a manoeuvre that has ended.
pub(super) struct Ended {
    pub(super) metrics: Metrics,
    pub(super) kept: Kept,
    /// Legs of a mission.
    pub(super) legs: Vec<LegRecord>,
}

/// The flight of a manoeuvre at its beginning, or of the mission that begins with it.
///
/// # Errors
/// Parameters that no arm has.
pub(super) fn begin(
    scenario: &ValidScenario,
    mission: Option<&ValidMission>,
    seed: Seed,
) -> Result<(Flight<f64>, Option<Box<Course>>), ConfigError> {
    let noise = noise(seed);
    match mission {
        None => Ok((Flight::new(Plan::new(scenario)?, noise)?, None)),
        Some(mission) => {
            let (flight, course) = Course::begin(mission.clone(), noise)?;
            Ok((flight, Some(Box::new(course))))
        }
    }
}

/// A manoeuvre in one lane: its place in the list, the samples that are left of it or until its mission
/// has to be asked, and its mission.
#[derive(Clone)]
pub(super) struct Place {
    pub(super) index: usize,
    pub(super) left: usize,
    course: Option<Box<Course>>,
}

/// What has become of a manoeuvre with some samples.
pub(super) enum After {
    /// It goes on.
    Same,
    /// The next leg of its mission has begun.
    NextLeg,
    /// It has ended.
    Ended(Box<Ended>),
}

impl Place {
    /// At the beginning of a flight.
    pub(super) fn new(index: usize, flight: &Flight<f64>, course: Option<Box<Course>>) -> Self {
        let left = match &course {
            None => flight.scenario().samples(),
            Some(course) => course.until_look(0) as usize,
        };
        Self {
            index,
            left,
            course,
        }
    }

    /// Samples flown in the legs before the one under way.
    pub(super) fn before(&self) -> usize {
        self.course.as_ref().map_or(0, |course| course.before()) as usize
    }

    /// To be told of every sample, of some at a time and no more than are left; `lost` says that the lane has
    /// left the limits of [`crate::validity`] with the last one. Another leg of its mission is put into the lane.
    pub(super) fn flown<T: Number>(
        &mut self,
        samples: usize,
        lost: bool,
        flight: &mut Flight<T>,
        lane: usize,
        recorder: Option<&mut Recorder<'_>>,
    ) -> After {
        self.left -= samples;
        if self.left != 0 && !lost {
            return After::Same;
        }
        if !lost && let Some(course) = &mut self.course {
            let other = match course.look(&flight.one(lane)) {
                Turn::Same => Some(After::Same),
                Turn::Next(next) => {
                    flight.put(lane, &next);
                    Some(After::NextLeg)
                }
                Turn::Done => None,
            };
            if let Some(after) = other {
                self.left = course.until_look(flight.common.sample.lane(lane) as u64) as usize;
                if let Some(recorder) = recorder {
                    recorder.begin_leg(flight, lane, course.origin(flight.sample_period()));
                }
                return after;
            }
        }
        let kept =
            recorder.map_or_else(Kept::default, |recorder| recorder.end(flight, lane, false));
        let single = flight.one(lane);
        let (metrics, legs) = match &self.course {
            None => (single.metrics(lost, 0.0), Vec::new()),
            Some(course) => (course.metrics(&single, lost), course.records(&single, lost)),
        };
        After::Ended(Box::new(Ended {
            metrics,
            kept,
            legs,
        }))
    }
}
