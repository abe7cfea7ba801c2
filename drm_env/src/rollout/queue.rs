//! What the threads of a rollout share: the manoeuvres that wait, and where results go.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::SyncSender;

use crate::config::mission::ValidMission;
use crate::config::scenario::ValidScenario;
use crate::error::Error;
use crate::hardware::sensors::INSTRUMENTS;
use crate::math::rng::Seed;
use crate::simulation::Flight;
use crate::simulation::course::Course;

use super::place::{Ended, begin};
use super::recorder::{Recorder, Recording};

/// Place of a manoeuvre in the list, and its end or why it has none.
pub(super) type Report = (usize, Result<Ended, Error>);

/// A manoeuvre about to be flown: its place in the list, its flight, and the mission that it begins.
pub(super) type Taken = (usize, Flight<f64>, Option<Box<Course>>);

pub(super) struct Queue<'a> {
    pub(super) scenarios: &'a [ValidScenario],
    /// Missions, each with the scenario in the same place; none are single manoeuvres.
    pub(super) missions: Option<&'a [ValidMission]>,
    pub(super) seeds: &'a [Seed],
    /// Instruments that are fitted whatever the scenarios say.
    pub(super) instruments: [bool; INSTRUMENTS],
    pub(super) recording: Option<&'a Recording>,
    pub(super) next: &'a AtomicUsize,
    pub(super) stop: &'a AtomicBool,
    pub(super) done: SyncSender<Report>,
}

impl<'a> Queue<'a> {
    /// The next manoeuvre to fly, at its beginning, with its mission if it is one.
    pub(super) fn take(&self) -> Option<Taken> {
        loop {
            if self.stopped() {
                return None;
            }
            let index = self.next.fetch_add(1, Ordering::Relaxed);
            let scenario = self.scenarios.get(index)?.fitted(self.instruments);
            let mission = self.missions.map(|missions| &missions[index]);
            let mission = mission.map(|mission| mission.fitted(self.instruments));
            match begin(&scenario, mission.as_ref(), self.seeds[index]) {
                Ok((flight, course)) => return Some((index, flight, course)),
                Err(error) => {
                    let error = error.within(&format!("scenarios[{index}]"));
                    self.send(index, Err(error.into()));
                }
            }
        }
    }

    /// Whether the rest is not to be flown.
    pub(super) fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Hands in a result.
    pub(super) fn send(&self, index: usize, result: Result<Ended, Error>) {
        // the receiver waits until every sender is gone
        let _ = self.done.send((index, result));
    }

    /// A recorder for so many lanes, if signals are kept.
    pub(super) fn recorder(&self, lanes: usize) -> Option<Recorder<'a>> {
        let recording = self.recording?;
        Some(Recorder::new(recording, lanes))
    }
}
