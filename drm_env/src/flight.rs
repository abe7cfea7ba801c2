//! One manoeuvre in flight: the plan made from its scenario, the state, and the sample loop of
//! sensors, wheels and integration that laws and agents drive.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::actuator::{Wheel, WheelState};
use crate::arm::PayloadProperties;
use crate::body::{Body, Leg, Motion, Outputs, WheelDrive};
use crate::control::{KnownInertia, Law, LawMemory, Measurement, WheelTorques};
use crate::error::{ConfigError, SnapshotError};
use crate::metrics::{Accumulator, Metrics, Sample};
use crate::plant::energy::Energy;
use crate::plant::{Extension, RigidInertia};
use crate::rng::Stream;
use crate::scenario::Scenario;
use crate::timeline::{Reference, Timeline};

/// What is fixed through one episode.
#[derive(Debug, Clone)]
pub struct Plan {
    /// The manoeuvre.
    pub scenario: Scenario,
    /// The payload as it is.
    pub payload: PayloadProperties,
    /// The payload as reported.
    pub reported: PayloadProperties,
    /// Reference and extension.
    pub timeline: Timeline,
    /// End of the slew profile, s.
    pub slew_end_time: f64,
    body: Body,
    reported_inertia: RigidInertia<f64>,
    known: KnownInertia<f64>,
    root: Wheel,
    tip: Wheel,
    root_delay: usize,
    tip_delay: usize,
    sensor_delay: usize,
    noisy: bool,
}

impl Plan {
    /// Plans a manoeuvre.
    ///
    /// # Errors
    /// A scenario that cannot be flown.
    pub fn new(scenario: &Scenario) -> Result<Self, ConfigError> {
        scenario.validate()?;
        let payload = scenario.true_payload()?;
        let reported = scenario.reported()?;
        let duration = scenario.deployment_time(&reported);
        let (root, tip) = (scenario.root_wheel.wheel(), scenario.tip_wheel.wheel());
        Ok(Self {
            scenario: *scenario,
            payload,
            reported,
            timeline: Timeline::new(
                &scenario.slew.pieces(),
                &scenario.deployment.pieces(duration),
            ),
            slew_end_time: scenario.slew.final_time(),
            body: Body::new(scenario, &payload)?,
            reported_inertia: RigidInertia::new(&scenario.arm, &reported),
            known: KnownInertia::new(&scenario.arm, &reported),
            root_delay: scenario.delay_samples("root_wheel.dead_time", root.dead_time)?,
            tip_delay: scenario.delay_samples("tip_wheel.dead_time", tip.dead_time)?,
            root,
            tip,
            sensor_delay: scenario.delay_samples("sensors.delay", scenario.sensors.delay)?,
            noisy: scenario.sensors.noise().iter().any(|&std| std > 0.0),
        })
    }

    /// Sign of the slew: 1 or -1.
    pub fn direction(&self) -> f64 {
        1.0_f64.copysign(self.scenario.slew.angle)
    }

    /// Open-loop torque of the slew motor, N m: rigid inverse dynamics of the reported arm.
    pub fn slew_torque(&self, time: f64) -> f64 {
        let reference = self.timeline.reference(time);
        self.reported_inertia.slew_torque(
            &self.timeline.extension(time),
            reference.rate,
            reference.accel,
        )
    }
}

/// What changes through one episode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FlightState {
    sample: u64,
    motion: Motion,
    /// What is seen of the motion.
    outputs: Outputs,
    root: WheelState<f64>,
    tip: WheelState<f64>,
    /// Commands on their way to the wheels, oldest first.
    root_line: VecDeque<f64>,
    tip_line: VecDeque<f64>,
    /// Outputs on their way to the reader, oldest first.
    sensor_line: VecDeque<[f64; 4]>,
    noise: Stream,
    measured: [f64; 4],
    memory: LawMemory<f64>,
    metrics: Accumulator,
    /// Torques at the beginning of the last sample, N m: slew, root, tip.
    torques: [f64; 3],
}

/// One manoeuvre in flight.
#[derive(Debug, Clone)]
pub struct Flight {
    plan: Plan,
    state: FlightState,
}

impl Flight {
    /// At t = 0; `noise` feeds the sensors.
    pub fn new(plan: Plan, noise: Stream) -> Self {
        let motion = plan.body.start(&plan.scenario);
        let outputs = plan.body.outputs(&motion, &plan.timeline.extension(0.0));
        let output = measurable(&outputs);
        let mut flight = Self {
            state: FlightState {
                sample: 0,
                motion,
                outputs,
                root: WheelState::rest(),
                tip: WheelState::rest(),
                root_line: VecDeque::from(vec![0.0; plan.root_delay]),
                tip_line: VecDeque::from(vec![0.0; plan.tip_delay]),
                sensor_line: VecDeque::from(vec![output; plan.sensor_delay]),
                noise,
                measured: output,
                memory: LawMemory::fresh(),
                metrics: Accumulator::new(plan.direction() * outputs.slew[0], outputs.tip[0]),
                torques: [0.0; 3],
            },
            plan,
        };
        flight.sense();
        flight
    }

    /// The plan.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The state, for a snapshot.
    pub fn state(&self) -> &FlightState {
        &self.state
    }

    /// Replaces the state by one taken from a flight of the same plan.
    ///
    /// # Errors
    /// A state of another plant; nothing has changed then.
    pub fn set_state(&mut self, state: FlightState) -> Result<(), SnapshotError> {
        if !self.plan.body.owns(&state.motion) {
            return Err(SnapshotError::Damaged(
                "it holds the state of another plant".into(),
            ));
        }
        self.state = state;
        Ok(())
    }

    /// Samples flown.
    pub fn sample(&self) -> u64 {
        self.state.sample
    }

    /// Time, s.
    pub fn time(&self) -> f64 {
        self.state.sample as f64 * self.plan.scenario.sample_period
    }

    /// Slew angle (rad) and half the deflections of the links' ends (m): theta, alpha, beta.
    pub fn position(&self) -> [f64; 3] {
        let Outputs {
            slew, alpha, beta, ..
        } = self.state.outputs;
        [slew[0], alpha[0], beta[0]]
    }

    /// Rates of theta, alpha, beta.
    pub fn velocity(&self) -> [f64; 3] {
        let Outputs {
            slew, alpha, beta, ..
        } = self.state.outputs;
        [slew[1], alpha[1], beta[1]]
    }

    /// Measured slew angle (rad), slew rate (rad/s), link-2 tip deflection (m) and its rate (m/s).
    pub fn measured(&self) -> [f64; 4] {
        self.state.measured
    }

    /// Slew reference now.
    pub fn reference(&self) -> Reference<f64> {
        self.plan.timeline.reference(self.time())
    }

    /// Extension now.
    pub fn extension(&self) -> Extension<f64> {
        self.plan.timeline.extension(self.time())
    }

    /// Deflection of the arm's tip from the rotating axis, m, and its rate, m/s; in the thesis plant
    /// 2 (alpha + beta).
    pub fn tip_deflection(&self) -> (f64, f64) {
        self.state.outputs.tip.into()
    }

    /// Torques at the beginning of the last sample, N m: slew motor, root wheel, tip wheel.
    pub fn last_torques(&self) -> [f64; 3] {
        self.state.torques
    }

    /// Stored momentum of root and tip wheel, N m s.
    pub fn wheel_momentum(&self) -> [f64; 2] {
        [self.state.root.momentum, self.state.tip.momentum]
    }

    /// Whether every coordinate and rate is finite.
    pub fn is_finite(&self) -> bool {
        self.state.outputs.is_finite()
    }

    /// Kinetic and potential energy now, J.
    pub fn energy(&self) -> Energy {
        let (scenario, payload) = (&self.plan.scenario, &self.plan.payload);
        self.plan
            .body
            .energy(&self.state.motion, &self.extension(), scenario, payload)
    }

    /// Metrics of the flight so far.
    pub fn metrics(&self, diverged: bool, episode_return: f64) -> Metrics {
        let scenario = &self.plan.scenario;
        self.state.metrics.metrics(
            scenario.sample_period,
            self.plan.slew_end_time,
            scenario.slew.angle.abs(),
            self.energy().total(),
            diverged,
            episode_return,
        )
    }

    /// What a law is told now.
    pub fn measurement(&self) -> Measurement<f64> {
        let reference = self.reference();
        let [angle, rate, deflection, deflection_rate] = self.state.measured;
        Measurement {
            slew_error: angle - reference.angle,
            slew_error_rate: rate - reference.rate,
            link2_deflection: deflection,
            link2_deflection_rate: deflection_rate,
            extension: self.extension().length,
        }
    }

    /// Torques that a law asks for now, N m, before saturation.
    pub fn law_torques(&mut self, law: &Law) -> WheelTorques<f64> {
        let measurement = self.measurement();
        law.torques(
            &measurement,
            &self.plan.known,
            &mut self.state.memory,
            self.plan.scenario.sample_period,
        )
    }

    /// Flies one sample period under held wheel commands (N m, before saturation); `slew` replaces
    /// the open-loop torque of the slew motor (N m).
    pub fn advance(&mut self, command: &WheelTorques<f64>, slew: Option<f64>) {
        let scenario = &self.plan.scenario;
        let (root, tip) = (self.plan.root, self.plan.tip);
        let mut limited =
            |line: fn(&mut FlightState) -> &mut VecDeque<f64>, command: f64, wheel: &Wheel| {
                let line = line(&mut self.state);
                line.push_back(command.clamp(-wheel.torque_limit, wheel.torque_limit));
                line.pop_front().unwrap_or(0.0)
            };
        let command = WheelTorques {
            root: limited(|s| &mut s.root_line, command.root, &root),
            tip: limited(|s| &mut s.tip_line, command.tip, &tip),
        };
        let saturated =
            command.root.abs() >= root.torque_limit || command.tip.abs() >= tip.torque_limit;
        let power = {
            let reference = self.reference();
            let torque = slew.unwrap_or_else(|| self.plan.slew_torque(self.time()));
            scenario
                .slew_motor
                .constants
                .power(torque, reference.rate, reference.accel)
        };

        self.integrate_sample(&command, slew);
        self.state.sample += 1;
        self.state.outputs = self
            .plan
            .body
            .outputs(&self.state.motion, &self.extension());
        self.sense();

        let [_, root_torque, tip_torque] = self.state.torques;
        let (of_root, of_tip) = (
            root_torque / root.torque_limit,
            tip_torque / tip.torque_limit,
        );
        if self.is_finite() {
            let sample = Sample {
                slew_angle: self.position()[0],
                slew_error: self.position()[0] - self.reference().angle,
                reach: self.plan.scenario.arm.link1.length + self.extension().length,
                deflection: self.tip_deflection().0,
                after_slew: self.time() >= self.plan.slew_end_time,
                effort: of_root * of_root + of_tip * of_tip,
                saturated,
                power,
            };
            self.state.metrics.take(&sample, self.plan.direction());
        }
    }

    /// Integrates over one sample period, cut where reference or extension switch.
    fn integrate_sample(&mut self, command: &WheelTorques<f64>, slew: Option<f64>) {
        let scenario = &self.plan.scenario;
        let start = self.time();
        let end = (self.state.sample + 1) as f64 * scenario.sample_period;
        let mut index = self.plan.timeline.index(start);
        let mut time = start;
        let mut first = None;
        while time < end {
            let piece = self.plan.timeline.piece(index);
            let until = end.min(self.plan.timeline.end(index));
            let span = until - time;
            // a remainder below a millionth of a step is rounding
            let steps = (span / scenario.integrator_step - 1e-6).ceil().max(1.0);
            let h = span / steps;
            let decay = |wheel: &Wheel| {
                if wheel.lag > 0.0 {
                    (1.0, libm::exp(-0.5 * h / wheel.lag))
                } else {
                    (0.0, 0.0)
                }
            };
            let drive = |wheel: &Wheel, command: f64| {
                let (memory, decay) = decay(wheel);
                WheelDrive {
                    command,
                    memory,
                    decay,
                    momentum_limit: wheel.momentum_limit,
                }
            };
            let leg = Leg {
                inertia: &self.plan.reported_inertia,
                piece,
                slew,
                root: drive(&self.plan.root, command.root),
                tip: drive(&self.plan.tip, command.tip),
                from: (time - piece.start).max(0.0),
                h,
                steps: steps as usize,
            };
            let dynamics = &scenario.dynamics;
            let switches = (dynamics.axial_load, dynamics.particle_following);
            let state = &mut self.state;
            let torques = self.plan.body.fly(
                &leg,
                switches,
                &mut state.motion,
                &mut state.root,
                &mut state.tip,
            );
            first.get_or_insert(torques);
            time = until;
            index += 1;
        }
        if let Some(torques) = first {
            self.state.torques = [torques.slew, torques.root, torques.tip];
        }
    }

    /// Reads the sensors at the present instant.
    fn sense(&mut self) {
        let truth = measurable(&self.state.outputs);
        self.state.sensor_line.push_back(truth);
        let mut measured = self.state.sensor_line.pop_front().unwrap_or(truth);
        let sensors = &self.plan.scenario.sensors;
        if self.plan.noisy {
            for (value, std) in measured.iter_mut().zip(sensors.noise()) {
                *value += std * self.state.noise.normal();
            }
        }
        for (value, quantum) in measured.iter_mut().zip(sensors.resolution()) {
            if quantum > 0.0 {
                *value = quantum * libm::round(*value / quantum);
            }
        }
        self.state.measured = measured;
    }
}

/// Slew angle and rate, link-2 tip deflection 2 beta and its rate.
fn measurable(outputs: &Outputs) -> [f64; 4] {
    let Outputs { slew, beta, .. } = outputs;
    [slew[0], slew[1], 2.0 * beta[0], 2.0 * beta[1]]
}
