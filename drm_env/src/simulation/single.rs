//! A flight of one manoeuvre.

use super::Flight;
use crate::config::scenario::Scenario;
use crate::control::LawMemory;
use crate::error::ConfigError;
use crate::hardware::delay::DelayLines;
use crate::hardware::reaction_wheel::{WheelState, WheelTorques};
use crate::hardware::sensors::OUTPUTS;
use crate::math::rng::Stream;
use crate::plant::energy::Energy;
use crate::reference::Extension;
use crate::reference::timeline::{Reference, Timeline};
use crate::simd::dispatch::Vector;
use crate::simulation::any_plant::{AnyPlant, Motion, Outputs};
use crate::simulation::clock::Clock;
use crate::simulation::constants::{LaneConstants, SharedConstants};
use crate::simulation::controller::{Fly, Held};
use crate::simulation::identification::Balance;
use crate::simulation::instruments::Instruments;
use crate::simulation::manoeuvre::Manoeuvre;
use crate::simulation::metrics::{Accumulator, Metrics};
use crate::simulation::plan::{Plan, ScenarioDelta};
use crate::simulation::state::LaneState;
use std::sync::Arc;

impl Flight<f64> {
    /// At t = 0; `noise` feeds the sensors.
    ///
    /// # Errors
    /// Parameters that no arm has.
    pub fn new(plan: Plan, noise: Stream) -> Result<Self, ConfigError> {
        let body = AnyPlant::new(&plan.scenario, &plan.payload, plan.range)?;
        Ok(Self::with_body(plan, body, noise))
    }

    /// At t = 0 with equations of motion that have been made before.
    pub(super) fn with_body(plan: Plan, body: AnyPlant<f64>, noise: Stream) -> Self {
        let index = plan.timeline.index(0.0);
        let clock = Clock::new(&plan.timeline, index, 0.0);
        let motion = body.start(&plan.scenario, &clock.extension);
        let outputs = motion.outputs();
        let exact = plan.is_plain();
        let mut flight = Self {
            base: Arc::new(Scenario::default()),
            shared: SharedConstants::new(&plan),
            fixed: LaneConstants::new(&plan),
            body,
            clock,
            common: LaneState {
                sample: 0.0,
                root: WheelState::rest(),
                tip: WheelState::rest(),
                memory: LawMemory::fresh(),
                metrics: Accumulator::new(plan.direction() * outputs.slew[0], outputs.tip[0]),
                torques: [0.0; 3],
                balance: Balance::fresh(),
            },
            motion,
            measured: None,
            effort: 0.0,
            resting: 0,
            plain: true,
            ideal: true,
            still: false,
            handled: 0,
            modelled: None,
            manoeuvres: vec![Manoeuvre {
                scenario: ScenarioDelta::Whole(Box::new(plan.scenario)),
                piece: index as u32,
                ideal_wheels: plan.has_ideal_wheels(),
                timeline: plan.timeline,
                lines: None,
                instruments: None,
                handling: plan.handling,
            }],
        };
        let sensors = plan.scenario.sensors;
        if sensors.has_instruments() {
            let instruments = Instruments::of(&flight, &sensors);
            flight.manoeuvres[0].instruments = instruments.map(Arc::new);
        }
        if !exact {
            let start = flight.readable(0, None);
            let lines = DelayLines::new(plan.delays, start, sensors, noise);
            flight.manoeuvres[0].lines = Some(Box::new(lines));
        }
        flight.refresh_flags();
        if !flight.plain {
            flight.sense(None);
        }
        flight
    }

    /// All that is measured.
    pub(super) fn all_measured(&self) -> [f64; OUTPUTS] {
        match &self.measured {
            Some(measured) => **measured,
            None => self.measurable(),
        }
    }

    /// The manoeuvre.
    pub fn scenario(&self) -> Scenario {
        self.scenario_of(0)
    }

    /// Reference and extension.
    pub fn timeline(&self) -> &Timeline {
        self.timeline_of(0)
    }

    /// Open-loop torque of the slew motor now, N m.
    pub fn slew_torque(&self) -> f64 {
        let Reference { rate, accel, .. } = self.clock.reference;
        self.fixed
            .inertia
            .slew_torque(&self.clock.extension, rate, accel)
    }

    /// End of the slew profile, s.
    pub fn slew_end(&self) -> f64 {
        self.fixed.slew_end_time
    }

    /// Puts a flight without lines at the beginning of a sample, with this deviation from the
    /// reference.
    pub(crate) fn place(&mut self, sample: f64, deviation: &[f64]) {
        let time = sample * self.shared.sample_period;
        let piece = self.timeline().index(time);
        self.clock = Clock::new(self.timeline(), piece, time);
        self.manoeuvres[0].piece = piece as u32;
        self.look_at_pieces();
        self.common.sample = sample;
        self.motion = self.motion_at(deviation);
    }

    /// Equations of motion.
    pub(crate) fn body(&self) -> &AnyPlant<f64> {
        &self.body
    }

    /// State of the equations of motion.
    pub(crate) fn motion(&self) -> &Motion<f64> {
        &self.motion
    }

    /// Time, s.
    pub fn time(&self) -> f64 {
        self.clock.time
    }

    /// Slew angle (rad) and half the deflections of the links' ends (m): theta, alpha, beta.
    pub fn position(&self) -> [f64; 3] {
        let Outputs {
            slew, alpha, beta, ..
        } = self.outputs();
        [slew[0], alpha[0], beta[0]]
    }

    /// Rates of theta, alpha, beta.
    pub fn velocity(&self) -> [f64; 3] {
        let Outputs {
            slew, alpha, beta, ..
        } = self.outputs();
        [slew[1], alpha[1], beta[1]]
    }

    /// Slew reference now.
    pub fn reference(&self) -> Reference<f64> {
        self.clock.reference
    }

    /// Extension now.
    pub fn extension(&self) -> Extension<f64> {
        self.clock.extension
    }

    /// Deflection of the arm's tip from the rotating axis, m, and its rate, m/s; in the thesis plant
    /// 2 (alpha + beta).
    pub fn tip_deflection(&self) -> (f64, f64) {
        self.outputs().tip.into()
    }

    /// Torques at the beginning of the last sample, N m: slew motor, root wheel, tip wheel.
    pub fn last_torques(&self) -> [f64; 3] {
        self.common.torques
    }

    /// Momenta of the root and the tip wheel, N m s.
    pub fn wheel_momenta(&self) -> [f64; 2] {
        [self.common.root.momentum, self.common.tip.momentum]
    }

    /// Whether every coordinate and rate is finite.
    pub fn is_finite(&self) -> bool {
        self.outputs().not_finite() == 0.0
    }

    /// Kinetic and potential energy now, J.
    pub fn energy(&self) -> Energy {
        let scenario = self.scenario();
        let Ok(payload) = scenario.true_payload() else {
            // it has been flown with one
            return Energy {
                kinetic: f64::NAN,
                potential: f64::NAN,
            };
        };
        let extension = &self.clock.extension;
        let motion = self.in_space(0);
        self.body.energy(&motion, extension, &scenario, &payload)
    }

    /// Metrics of the flight so far; see [`Metrics`] for those of one that has left the limits of
    /// [`crate::validity`].
    pub fn metrics(&self, diverged: bool, episode_return: f64) -> Metrics {
        self.metrics_with(self.energy().total(), diverged, episode_return)
    }

    /// Flies one sample period under held wheel commands (N m, before saturation); `slew` replaces
    /// the open-loop torque of the slew motor (N m).
    pub fn advance(&mut self, command: &WheelTorques<f64>, slew: Option<f64>) {
        f64::enter(Fly {
            flight: self,
            samples: 1,
            controller: &mut Held {
                command: *command,
                slew,
            },
        });
    }
}
