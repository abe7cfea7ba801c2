//! Manoeuvres in flight, one a lane: state, and the sample loop of sensors, wheels and integration
//! that laws and agents drive.

pub(crate) mod any_plant;
pub(crate) mod clock;
pub(crate) mod constants;
mod continuation;
pub(crate) mod controller;
pub(crate) mod course;
mod divergence;
mod handled;
pub(crate) mod hook;
pub mod identification;
mod instruments;
mod lanes;
mod law_model;
pub mod loads;
mod manoeuvre;
pub mod metrics;
pub(crate) mod plan;
pub(crate) mod propagate_consistent;
pub(crate) mod propagate_thesis;
mod sample;
mod single;
mod snapshot;
pub(crate) mod span;
pub(crate) mod state;

use std::sync::Arc;

use crate::config::distribution::Setting;
use crate::config::scenario::Scenario;
use crate::control::Measurement;
use crate::hardware::reaction_wheel::WheelTorques;
use crate::hardware::sensors::{INSTRUMENTS, OUTPUTS, TIP_RATE};
use crate::plant::RigidInertia;
use crate::reference::timeline::Timeline;
use crate::simd::{Laned, Number};
use crate::simulation::any_plant::{AnyPlant, Motion, Outputs};
use crate::simulation::clock::Clock;
use crate::simulation::constants::{LaneConstants, SharedConstants};
pub use crate::simulation::continuation::Exchange;
pub use crate::simulation::course::LegRecord;
use crate::simulation::identification::mass_error;
use crate::simulation::law_model::Modelled;
pub use crate::simulation::law_model::servo_model;
use crate::simulation::manoeuvre::Manoeuvre;
use crate::simulation::metrics::Metrics;
pub use crate::simulation::snapshot::FlightState;
use crate::simulation::state::LaneState;

pub use crate::simulation::plan::Plan;

/// `T::WIDTH` manoeuvres in flight, which share their sample period, steps and equations of motion.
#[derive(Debug, Clone)]
pub struct Flight<T: Number = f64> {
    /// What the scenarios are told by their differences from.
    base: Arc<Scenario>,
    manoeuvres: Vec<Manoeuvre>,
    shared: SharedConstants,
    fixed: LaneConstants<T>,
    body: AnyPlant<T>,
    clock: Clock<T>,
    pub(crate) common: LaneState<T>,
    motion: Motion<T>,
    /// The measured outputs, see [`OUTPUTS`], where they are not what they are without sensors.
    measured: Option<Box<[T; OUTPUTS]>>,
    /// Squared torque fractions of both wheels over the last sample.
    effort: T,
    /// Lanes that stay as they are, a bit each.
    resting: u32,
    /// Whether commands and outputs pass as they are in every lane.
    plain: bool,
    /// Whether every wheel is ideal.
    ideal: bool,
    /// Whether the length is fixed in every lane, in the present piece.
    still: bool,
    /// Lanes in a leg that does something beside its manoeuvre, a bit each: they fly alone.
    handled: u32,
    /// The arm as a law that models it knows it; made when such a law first flies.
    modelled: Option<Box<Modelled<T>>>,
}

impl<T: Number> Flight<T> {
    /// Scenario of one lane.
    pub(crate) fn scenario_of(&self, lane: usize) -> Scenario {
        self.manoeuvres[lane].scenario.scenario(&self.base)
    }

    /// Timeline of one lane.
    #[inline(always)]
    pub(crate) fn timeline_of(&self, lane: usize) -> &Timeline {
        &self.manoeuvres[lane].timeline
    }

    /// Piece of the timeline in force in one lane.
    #[inline(always)]
    pub(crate) fn piece_of(&self, lane: usize) -> usize {
        self.manoeuvres[lane].piece as usize
    }

    /// What is seen of the motion.
    #[inline(always)]
    pub(crate) fn outputs(&self) -> Outputs<T> {
        self.motion.outputs()
    }

    /// Slew angle (rad) and rate (rad/s), link-2 tip deflection (m) and its rate (m/s) as measured.
    #[inline(always)]
    pub fn measured(&self) -> [T; 4] {
        let [angle, rate, deflection, deflection_rate, ..] = match &self.measured {
            Some(measured) => **measured,
            None => self.outputs().measurable(T::splat(0.0)),
        };
        [angle, rate, deflection, deflection_rate]
    }

    /// Rate at which the tip turns (rad/s) as measured by a gyro at the tip wheel.
    #[inline(always)]
    pub fn measured_tip_rate(&self) -> T {
        match &self.measured {
            Some(measured) => measured[TIP_RATE],
            None => self.tip_turn_rate(),
        }
    }

    /// Rate at which the tip turns, rad/s.
    #[inline(always)]
    fn tip_turn_rate(&self) -> T {
        self.body.tip_turn_rate(&self.motion, &self.clock.extension)
    }

    /// Bending moments at the roots of link 1 and link 2 (N m) as strain gauges measure them, and acceleration
    /// of the tip (m/s^2) as an accelerometer does; 0 of an instrument that is not there.
    #[inline(always)]
    pub(crate) fn measured_by_instruments(&self) -> [T; INSTRUMENTS] {
        let none = T::splat(0.0);
        self.measured.as_ref().map_or([none; INSTRUMENTS], |all| {
            let [.., link1, link2, tip] = **all;
            [link1, link2, tip]
        })
    }

    /// All that can be measured, as it is, but for what the instruments read.
    #[inline(always)]
    fn measurable(&self) -> [T; OUTPUTS] {
        self.outputs().measurable(self.tip_turn_rate())
    }

    pub(crate) fn fixed(&self) -> &LaneConstants<T> {
        &self.fixed
    }

    pub(crate) fn clock(&self) -> &Clock<T> {
        &self.clock
    }

    pub(crate) fn sample_period(&self) -> f64 {
        self.shared.sample_period
    }

    /// End of the slew profile, s.
    pub(crate) fn slew_end_time(&self) -> T {
        self.fixed.slew_end_time
    }

    /// Squared torque fractions of both wheels over the last sample.
    #[inline(always)]
    pub(crate) fn effort(&self) -> T {
        self.effort
    }

    /// Slew angle minus its reference, rad.
    #[inline(always)]
    pub(crate) fn slew_error(&self) -> T {
        self.outputs().slew[0] - self.clock.reference.angle
    }

    /// Distance of the tip from the shoulder, m.
    #[inline(always)]
    pub(crate) fn reach(&self) -> T {
        self.fixed.link1_length + self.clock.extension.length
    }

    /// Error of the reported mass, true / reported - 1, as the balance of angular momentum tells it: what
    /// the motor was told to give for the reported arm and what the wheels have taken up is the true
    /// arm's inertia times its measured rate. Right up to the vibration, for an open-loop slew; 0 while
    /// the arm hardly turns and without a reported payload.
    #[inline(always)]
    pub(crate) fn identified_mass_error(&self) -> T {
        let [rate, momentum, reported, payload] = self.momentum_balance();
        mass_error(momentum, rate, reported, payload)
    }

    /// Measured slew rate (rad/s), angular momentum of the arm (N m s), reported moments of inertia (kg m^2) of
    /// arm and payload and of the payload alone.
    #[inline(always)]
    fn momentum_balance(&self) -> [T; 4] {
        let a = self.clock.extension.length;
        let [_, rate, ..] = self.measured();
        let reported = self.fixed.inertia.at(a);
        let payload = self.fixed.payload_inertia.at(a);
        let stored = self.common.root.momentum - self.fixed.stored;
        let wheels = stored + self.common.tip.momentum;
        let momentum = reported.mul_add(self.clock.reference.rate, -wheels);
        [rate, momentum, reported, payload]
    }

    /// Takes what the balance of angular momentum tells of the payload now.
    #[inline(always)]
    pub(super) fn hear(&mut self) {
        let [rate, momentum, reported, payload] = self.momentum_balance();
        let rates = [self.clock.reference.rate, rate];
        let seconds = self.shared.sample_period;
        let balance = &mut self.common.balance;
        balance.hear(seconds, rates, momentum, reported, payload);
    }

    /// The error of the reported mass, true / reported - 1, as the balance of angular momentum has told it since
    /// the beginning of the flight or leg, and the rate of the arm as a whole by it, rad/s.
    #[inline(always)]
    pub(crate) fn estimate(&self) -> [T; 2] {
        let [_, momentum, reported, payload] = self.momentum_balance();
        let error = self.common.balance.error(payload);
        [error, momentum / error.mul_add(payload, reported)]
    }

    /// Measured error of the slew at the tip, with the deflection that the reference's acceleration keeps up by
    /// the model that has been made, m.
    #[inline(always)]
    pub(crate) fn still_tip_error(&self) -> T {
        let [angle, ..] = self.measured();
        let reference = &self.clock.reference;
        let error = self.reach() * (angle - reference.angle);
        let [mass_error, _] = self.estimate();
        let deflection = self.modelled.as_ref().map_or(T::splat(0.0), |modelled| {
            modelled
                .model
                .still_deflection(self.clock.extension.length, mass_error)
        });
        deflection.mul_add(reference.accel, error)
    }

    /// The reported payload's share of a lane's moment of inertia.
    pub(crate) fn reported_share(&self, lane: usize) -> RigidInertia<f64> {
        self.fixed.payload_inertia.lane_of(lane)
    }

    /// What a law is told now, but for [`Measurement::tip_turn_rate`], which is zero: few laws want it.
    #[inline(always)]
    pub fn measurement(&self) -> Measurement<T> {
        let [angle, rate, deflection, deflection_rate] = self.measured();
        Measurement {
            slew_error: angle - self.clock.reference.angle,
            slew_error_rate: rate - self.clock.reference.rate,
            link2_deflection: deflection,
            link2_deflection_rate: deflection_rate,
            extension: self.clock.extension.length,
            extension_rate: self.clock.extension.rate,
            reference_rate: self.clock.reference.rate,
            reference_accel: self.clock.reference.accel,
            slew_torque: self.common.torques[0],
            root_momentum: self.common.root.momentum - self.fixed.stored,
            tip_momentum: self.common.tip.momentum,
            tip_turn_rate: T::splat(0.0),
        }
    }

    /// Torques that a law asks for now, N m, before saturation.
    #[inline(always)]
    pub fn law_torques(&mut self, law: &crate::control::Law) -> WheelTorques<T> {
        let mut measurement = self.measurement();
        if law.needs_tip_rate() {
            measurement.tip_turn_rate = self.measured_tip_rate();
        }
        if let Some(servo) = law.needs_model() {
            self.model_for(servo);
            if let Some(share) = servo.lean {
                self.plan_torques(&measurement, share);
            }
        }
        law.torques(
            &measurement,
            &self.fixed.known,
            self.modelled.as_ref().map(|modelled| &modelled.model),
            &mut self.common.memory,
            self.shared.sample_period,
        )
    }

    /// Memory of it, bytes, about: less where lanes have the same.
    pub(crate) fn bytes(&self) -> usize {
        let lines = |lane: &Manoeuvre| lane.lines.as_ref().map_or(0, |lines| lines.bytes());
        let instruments = |lane: &Manoeuvre| lane.instruments.as_ref().map_or(0, |all| all.bytes());
        let each = |lane: &Manoeuvre| lines(lane) + instruments(lane);
        let lanes: usize = self.manoeuvres.iter().map(each).sum();
        size_of::<Self>()
            + size_of::<Scenario>()
            + self.manoeuvres.len() * (size_of::<Manoeuvre>() + size_of::<[Setting; 4]>())
            + lanes
            + self.body.bytes()
    }
}

impl Flight<f64> {
    /// Whether no payload is reported.
    pub(crate) fn knows_no_payload(&self) -> bool {
        self.fixed.payload_inertia.at(self.clock.extension.length) <= 0.0
    }

    /// [`Flight::metrics`] with NaN for the energy, which costs as much as a control period.
    pub(crate) fn metrics_under_way(&self, diverged: bool, episode_return: f64) -> Metrics {
        self.metrics_with(f64::NAN, diverged, episode_return)
    }

    fn metrics_with(&self, energy: f64, diverged: bool, episode_return: f64) -> Metrics {
        let found = self.common.metrics.metrics(
            self.shared.sample_period,
            self.slew_end(),
            self.scenario().slew.target().abs(),
            energy,
            diverged,
            episode_return,
        );
        if self.void() == 0 {
            found
        } else {
            found.of_void()
        }
    }
}
