//! Episodes of an environment that a network flies, side by side.

use std::sync::Arc;

use crate::config::mission::Mission;
use crate::config::scenario::Scenario;
use crate::config::{Actuator, ValidConfig};
use crate::control::mlp::{Network, Scratch};
use crate::env::Env;
use crate::env::observation::told_payload;
use crate::env::pack::EnvPack;
use crate::env::setup::Setup;
use crate::error::{ConfigError, SimulationError};
use crate::hardware::sensors::INSTRUMENTS;
use crate::simd::dispatch::{Vector, Work, variants};
use crate::simd::mask::everyone;
use crate::simd::mask::lanes_of;
use crate::simulation::Flight;
use crate::simulation::hook::StepHook;

use super::place::Ended;
use super::queue::{Queue, Taken};
use super::recorder::{Kept, Recorder};

/// A network and the task it flies.
#[derive(Debug)]
pub(super) struct NetworkPilot<'a> {
    network: &'a Network,
    setup: Arc<Setup>,
    /// An environment of the task, whose episode is replaced by each manoeuvre.
    template: Env,
    /// Whether the slew motor is the network's.
    drives_slew: bool,
}

impl<'a> NetworkPilot<'a> {
    /// Puts a network into the task of a configuration.
    ///
    /// # Errors
    /// A network with other inputs than the observation has
    /// entries, or other outputs than there are actuators.
    pub(super) fn new(network: &'a Network, config: &ValidConfig) -> Result<Self, ConfigError> {
        let setup = Setup::new(config);
        let (entries, actuators) = (setup.observation_size, config.task.actuators.len());
        if network.inputs() != entries {
            let requirement =
                format!("must have {entries} inputs, one for each entry of the observation");
            return Err(ConfigError::value("policy", requirement, network.inputs()));
        }
        if network.outputs() != actuators {
            let requirement = format!("must have {actuators} outputs, one for each actuator");
            return Err(ConfigError::value("policy", requirement, network.outputs()));
        }
        Ok(Self {
            network,
            template: Env::with_setup(Arc::clone(&setup))?,
            drives_slew: config.task.actuators.contains(&Actuator::SlewMotor),
            setup,
        })
    }

    /// Refuses a scenario that the task's environments could not have.
    pub(super) fn check(&self, scenario: &Scenario) -> Result<(), ConfigError> {
        let of_task = &self.setup.config.scenario;
        let mut pairs = vec![
            (
                "sample_period",
                scenario.sample_period,
                of_task.sample_period,
            ),
            ("horizon", scenario.horizon, of_task.horizon),
        ];
        if self.drives_slew {
            let limits = (&scenario.slew_motor, &of_task.slew_motor);
            let limits = (limits.0.torque_limit, limits.1.torque_limit);
            pairs.push(("slew_motor.torque_limit", limits.0, limits.1));
        }
        for (name, value, expected) in pairs {
            if value != expected {
                let requirement = format!("must be {expected}, as in the policy's task");
                return Err(ConfigError::value(name, requirement, value));
            }
        }
        Ok(())
    }

    /// Instruments that the network sees.
    pub(super) fn instruments(&self) -> [bool; INSTRUMENTS] {
        self.setup.config.task.instruments()
    }

    /// What is told of the payload of a flight: mass (kg), length and width (m).
    fn told(&self, flight: &Flight<f64>) -> [f64; 3] {
        // a payload that cannot be has been refused with its scenario
        told_payload(&flight.scenario(), &self.setup.config.task).unwrap_or([f64::NAN; 3])
    }

    /// The mission of the task's episodes, if they are missions.
    pub(super) fn mission(&self) -> Option<&Mission> {
        self.setup.config.mission.as_ref()
    }

    /// Flies episodes side by side until there are no more: a lane that has ended takes the next one.
    pub(super) fn fly<T: Vector>(&self, queue: &Queue<'_>) {
        let Some(first) = queue.take() else {
            return;
        };
        let mut team = Team::<T>::new(self, queue, first);
        let mut more = true;
        loop {
            for lane in 0..T::WIDTH {
                while more && team.lanes[lane].is_none() {
                    match queue.take() {
                        None => more = false,
                        Some(next) if team.pack.flight.accepts(&next.1) => {
                            team.begin(lane, next);
                        }
                        Some(next) => {
                            // its equations or samples are not those of the others
                            let mut alone = Team::<f64>::new(self, queue, next);
                            while !queue.stopped() && alone.step() {}
                        }
                    }
                }
            }
            if queue.stopped() || !team.step() {
                return;
            }
        }
    }
}

/// Episodes in flight, one a lane.
struct Team<'a, 'b, T: Vector> {
    pilot: &'a NetworkPilot<'a>,
    queue: &'a Queue<'b>,
    pack: EnvPack<T>,
    /// Places in the list.
    lanes: Vec<Option<usize>>,
    recorder: Option<Recorder<'b>>,
    /// Observation, as many entries as the network has inputs.
    inputs: Vec<T>,
    outputs: Vec<T>,
    scratch: Scratch<T>,
    /// A row a lane.
    actions: Vec<f32>,
}

impl<'a, 'b, T: Vector> Team<'a, 'b, T> {
    /// An episode at its beginning in the first lane; the others are empty.
    fn new(pilot: &'a NetworkPilot<'a>, queue: &'a Queue<'b>, taken: Taken) -> Self {
        let (index, flight, course) = taken;
        let mut single = pilot.template.clone();
        // in the template's place, for its equations may be others
        single.flight.clone_from(&flight);
        let payload = pilot.told(&flight);
        single.start(0, &flight, payload, queue.seeds[index], 0);
        single.members[0].course = course;
        let network = pilot.network;
        let mut lanes = vec![None; T::WIDTH];
        lanes[0] = Some(index);
        Self {
            pilot,
            queue,
            pack: EnvPack::spread(&single),
            lanes,
            recorder: queue.recorder(T::WIDTH),
            inputs: vec![T::splat(0.0); network.inputs()],
            outputs: vec![T::splat(0.0); network.outputs()],
            scratch: Scratch::new(),
            actions: vec![0.0; T::WIDTH * network.outputs()],
        }
    }

    fn begin(&mut self, lane: usize, taken: Taken) {
        let (index, flight, course) = taken;
        let payload = self.pilot.told(&flight);
        let seed = self.queue.seeds[index];
        self.pack.start(lane, &flight, payload, seed, 0);
        self.pack.members[lane].course = course;
        self.lanes[lane] = Some(index);
    }

    /// One control period of every episode, and the end of those that end with it; whether there are
    /// any.
    fn step(&mut self) -> bool {
        let taken = (0..T::WIDTH).filter(|lane| self.lanes[*lane].is_some());
        let mut flying = taken.fold(0_u32, |bits, lane| bits | 1 << lane);
        if flying == 0 {
            return false;
        }
        let acted = T::enter(Act {
            network: self.pilot.network,
            observations: &self.pack.observations,
            inputs: &mut self.inputs,
            scratch: &mut self.scratch,
            outputs: &mut self.outputs,
        });
        if let Err(error) = acted {
            // sizes have been compared before: no lane can fly
            for index in self.lanes.iter_mut().filter_map(Option::take) {
                self.queue.send(index, Err(error.clone().into()));
            }
            return false;
        }
        flying &= !self.refuse_actions();
        if let Some(recorder) = &mut self.recorder {
            recorder.look_again();
        }
        let hook = self.recorder.as_mut();
        let hook = hook.map(|recorder| recorder as &mut dyn StepHook<T>);
        let outcomes = self.pack.step_watched(&self.actions, flying, hook);
        if let Some(recorder) = &mut self.recorder {
            for lane in 0..T::WIDTH {
                if let Some(course) = self.pack.course_of(lane) {
                    let flight = &self.pack.flight;
                    recorder.begin_leg(flight, lane, course.origin(flight.sample_period()));
                }
            }
        }
        let ended = (outcomes.terminated | outcomes.truncated) & flying & everyone::<T>();
        for lane in lanes_of(ended) {
            let Some(index) = self.lanes[lane].take() else {
                continue;
            };
            let (flight, driven) = (&self.pack.flight, self.pilot.drives_slew);
            let kept = self
                .recorder
                .as_mut()
                .map_or_else(Kept::default, |recorder| recorder.end(flight, lane, driven));
            let env = self.pack.one(lane);
            let ended = Ended {
                metrics: env.metrics(),
                kept,
                legs: env.legs(),
            };
            self.queue.send(index, Ok(ended));
        }
        true
    }

    /// Writes the actions row by row; episodes in which one is not finite end with an error, and their
    /// lanes are returned, a bit each.
    fn refuse_actions(&mut self) -> u32 {
        let count = self.outputs.len();
        let mut refused = 0;
        for (lane, row) in self.actions.chunks_exact_mut(count).enumerate() {
            for (entry, output) in row.iter_mut().zip(&self.outputs) {
                *entry = output.lane(lane) as f32;
            }
            let Some(scenario) = self.lanes[lane] else {
                continue;
            };
            if let Some(entry) = row.iter().position(|value| !value.is_finite()) {
                let error = SimulationError::PolicyNotFinite {
                    entry,
                    scenario,
                    time: self.pack.flight.clock().time.lane(lane),
                    value: f64::from(row[entry]),
                };
                self.lanes[lane] = None;
                self.queue.send(scenario, Err(error.into()));
                refused |= 1 << lane;
            }
        }
        refused
    }
}

/// Actions of the observations of every lane.
struct Act<'a, T> {
    network: &'a Network,
    /// A row a lane.
    observations: &'a [f32],
    inputs: &'a mut [T],
    scratch: &'a mut Scratch<T>,
    outputs: &'a mut [T],
}

variants!(act);

impl<T: Vector> Work for Act<'_, T> {
    type Output = Result<(), SimulationError>;
    type Variants = act::Here;

    #[inline(always)]
    fn run(self) -> Self::Output {
        let size = self.inputs.len();
        for i in 0..size {
            let mut value = T::splat(0.0);
            for lane in 0..T::WIDTH {
                value.set_lane(lane, f64::from(self.observations[lane * size + i]));
            }
            self.inputs[i] = value;
        }
        self.network.act(self.inputs, self.scratch, self.outputs)
    }
}
