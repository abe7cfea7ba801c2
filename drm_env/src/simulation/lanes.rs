//! Manoeuvres put into lanes and taken out of them.

use super::Flight;
use crate::simd::mask::everyone;
use crate::simd::{Laned, Number};
use crate::simulation::any_plant::{AnyPlant, Motion};
use crate::simulation::clock::Clock;
use crate::simulation::constants::LaneConstants;
use crate::simulation::manoeuvre::Manoeuvre;
use crate::simulation::plan::ScenarioDelta;
use crate::simulation::state::LaneState;
use std::sync::Arc;

impl<T: Number> Flight<T> {
    /// The same manoeuvre in every lane.
    pub(crate) fn spread(single: &Flight<f64>) -> Self {
        let mut manoeuvre = single.manoeuvres[0].clone();
        manoeuvre.scenario = ScenarioDelta::Differences(Box::new([]));
        let mut flight = Self {
            base: Arc::new(single.scenario_of(0)),
            manoeuvres: vec![manoeuvre; T::WIDTH],
            shared: single.shared,
            fixed: LaneConstants::spread(&single.fixed),
            body: AnyPlant::spread(&single.body),
            clock: Clock::spread(&single.clock),
            common: LaneState::spread(&single.common),
            motion: Motion::spread(&single.motion),
            measured: None,
            effort: T::splat(0.0),
            resting: 0,
            plain: true,
            ideal: true,
            still: false,
            handled: 0,
            modelled: None,
        };
        flight.refresh_flags();
        if let (Some(measured), Some(single)) = (&mut flight.measured, &single.measured) {
            **measured = Laned::spread(&**single);
        }
        flight
    }

    /// Whether a manoeuvre can fly beside the others.
    pub(crate) fn accepts(&self, single: &Flight<f64>) -> bool {
        self.shared == single.shared && self.body.accepts(&single.body)
    }

    /// Replaces the manoeuvre of one lane by one that [`Flight::accepts`].
    pub(crate) fn put(&mut self, lane: usize, single: &Flight<f64>) {
        let mut manoeuvre = single.manoeuvres[0].clone();
        manoeuvre.scenario = ScenarioDelta::beside(&self.base, &single.scenario_of(0));
        // most lanes have the same timeline
        if let Some(same) = self
            .manoeuvres
            .iter()
            .find(|other| other.timeline == manoeuvre.timeline)
        {
            manoeuvre.timeline = Arc::clone(&same.timeline);
        }
        self.manoeuvres[lane] = manoeuvre;
        self.fixed.put_lane(lane, &single.fixed);
        if let Some(modelled) = &mut self.modelled {
            modelled.forget(lane);
        }
        self.body.put(lane, &single.body);
        self.clock.put_lane(lane, &single.clock);
        self.common.put_lane(lane, &single.common);
        self.motion.put(lane, &single.motion);
        self.refresh_flags();
        let measured = single.all_measured();
        if let Some(all) = &mut self.measured {
            all.put_lane(lane, &measured);
        }
    }

    /// The manoeuvre of one lane.
    pub(crate) fn one(&self, lane: usize) -> Flight<f64> {
        let scenario = self.scenario_of(lane);
        let mut manoeuvre = self.manoeuvres[lane].clone();
        manoeuvre.scenario = ScenarioDelta::Whole(Box::new(scenario));
        Flight {
            base: Arc::clone(&self.base),
            shared: self.shared,
            fixed: self.fixed.lane_of(lane),
            body: self.body.one(lane),
            clock: self.clock.lane_of(lane),
            common: self.common.lane_of(lane),
            motion: self.motion.one(lane),
            measured: match (&self.measured, &manoeuvre.lines) {
                (Some(measured), Some(_)) => Some(Box::new(measured.lane_of(lane))),
                _ => None,
            },
            effort: self.effort.lane(lane),
            resting: 0,
            plain: manoeuvre.lines.is_none(),
            ideal: manoeuvre.ideal_wheels,
            still: manoeuvre.is_still(),
            handled: u32::from(manoeuvre.handling.is_some()),
            modelled: None,
            manoeuvres: vec![manoeuvre],
        }
    }

    pub(super) fn refresh_flags(&mut self) {
        self.plain = self.manoeuvres.iter().all(|m| m.lines.is_none());
        self.ideal = self.manoeuvres.iter().all(|m| m.ideal_wheels);
        self.handled = 0;
        for (lane, manoeuvre) in self.manoeuvres.iter().enumerate() {
            self.handled |= u32::from(manoeuvre.handling.is_some()) << lane;
        }
        self.look_at_pieces();
        if self.plain {
            self.measured = None;
        } else if self.measured.is_none() {
            self.measured = Some(Box::new(self.measurable()));
        }
    }

    pub(super) fn look_at_pieces(&mut self) {
        self.still = self.manoeuvres.iter().all(Manoeuvre::is_still);
    }

    /// Puts every lane where a flight of the same manoeuvre is.
    pub(crate) fn begin_at(&mut self, single: &Flight<f64>) {
        self.clock = Clock::spread(&single.clock);
        self.common = LaneState::spread(&single.common);
        self.motion = Motion::spread(&single.motion);
        for manoeuvre in &mut self.manoeuvres {
            manoeuvre.piece = single.manoeuvres[0].piece;
        }
        self.look_at_pieces();
    }

    /// Replaces the motion of one lane.
    pub(crate) fn deviate(&mut self, lane: usize, motion: &Motion<f64>) {
        self.motion.put(lane, motion);
    }

    /// Lanes that do not fly until told otherwise, a bit each.
    pub(crate) fn rest(&mut self, lanes: u32) {
        self.resting = lanes & everyone::<T>();
    }

    /// Lanes that do not fly.
    pub(crate) fn resting(&self) -> u32 {
        self.resting
    }
}
