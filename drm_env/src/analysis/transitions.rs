//! The discrete linear model of a whole manoeuvre, measured on the equations that are flown: how a
//! deviation from the reference and held wheel torques move the arm from one instant to the next, and
//! the error of its tip in between.

use crate::config::scenario::ValidScenario;
use crate::error::{ConfigError, Error, SimulationError};
use crate::hardware::reaction_wheel::WheelTorques;
use crate::hardware::reaction_wheel::{RootWheel, TipWheel};
use crate::hardware::sensors::Sensors;
use crate::interruption;
use crate::math::rng::{Purpose, Seed, Stream};
use crate::memory;
use crate::rollout::law::{Given, LawController, Source};
use crate::simd::dispatch::Vector;
use crate::simd::{Instructions, Narrow, Number};
use crate::simulation::Flight;
use crate::simulation::any_plant::Motion;
use crate::simulation::controller::Fly;
use crate::simulation::hook::{Hooked, StepHook};
use crate::simulation::plan::Plan;

/// Deviations that are flown to measure their effect, in the units of the state: all equations but
/// the axial load are linear, and with these its nonlinear part is below rounding.
const DEVIATION: f64 = 1e-5;

/// Fraction of a wheel's torque limit that is flown to measure its effect.
const TORQUE_FRACTION: f64 = 0.01;

/// Most memory that the matrices of one manoeuvre may take, bytes.
pub const MAX_BYTES: u64 = 4 << 30;

/// x(k+1) = A x(k) + B u(k) + c and, for each sample i of the interval that follows k,
/// z = C x(k) + D u(k) + d, where x is the deviation from the undeflected arm at the reference (the
/// coordinates, then their rates), u are the torques of root and tip wheel (N m), held through the
/// interval and not limited, and z is the error of the tip, r e + y (m). Wheels are ideal: no lag,
/// no dead time, any momentum.
#[derive(Debug, Clone, PartialEq)]
pub struct Transitions {
    /// Entries of x.
    pub size: usize,
    /// Number of intervals.
    pub intervals: usize,
    /// Samples in an interval.
    pub hold: usize,
    /// x at the beginning.
    pub start: Vec<f64>,
    /// A, shape (intervals, size, size).
    pub transition: Vec<f64>,
    /// B, shape (intervals, size, 2).
    pub input: Vec<f64>,
    /// c, shape (intervals, size).
    pub offset: Vec<f64>,
    /// C, shape (intervals, hold, size).
    pub error_state: Vec<f64>,
    /// D, shape (intervals, hold, 2).
    pub error_input: Vec<f64>,
    /// d, shape (intervals, hold).
    pub error_offset: Vec<f64>,
}

impl Transitions {
    /// Measures the model of a manoeuvre at instants `hold` samples apart.
    ///
    /// # Errors
    /// A scenario that cannot be flown; a hold that does not divide its samples; more than
    /// [`MAX_BYTES`]; an arm that leaves the limits of [`crate::validity`] from the reference within
    /// `hold` samples.
    pub fn of(
        scenario: impl TryInto<ValidScenario, Error: Into<ConfigError>>,
        hold: usize,
    ) -> Result<Self, Error> {
        Self::of_valid(&scenario.try_into().map_err(Into::into)?, hold)
    }

    fn of_valid(scenario: &ValidScenario, hold: usize) -> Result<Self, Error> {
        let mut ideal = **scenario;
        let RootWheel { torque_limit, .. } = ideal.root_wheel;
        ideal.root_wheel = RootWheel {
            torque_limit,
            ..RootWheel::default()
        };
        let TipWheel { torque_limit, .. } = ideal.tip_wheel;
        ideal.tip_wheel = TipWheel {
            torque_limit,
            ..TipWheel::default()
        };
        ideal.sensors = Sensors::default();
        let samples = ideal.samples();
        if !samples.is_multiple_of(hold) {
            let requirement = format!("must divide the {samples} samples of the manoeuvre");
            return Err(ConfigError::value("hold", requirement, hold).into());
        }
        let noise = Stream::new(Seed::from_u64(0), 0, Purpose::Sensors);
        let flight = Flight::new(Plan::new(&ideal)?, noise)?;
        check_size(2 * flight.coordinates(), samples, hold)?;
        let measured = match Instructions::detect() {
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx512 => measure::<crate::simd::x86::Wide8>(&flight, samples, hold),
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2 => measure::<crate::simd::x86::Wide4>(&flight, samples, hold),
            _ => measure::<Narrow>(&flight, samples, hold),
        };
        measured.map_err(Into::into)
    }
}

/// Refuses a model that would not fit into memory.
fn check_size(size: usize, samples: usize, hold: usize) -> Result<(), ConfigError> {
    let [size, samples, hold] = [size, samples, hold].map(|count| count as u128);
    let numbers = samples / hold * size * (size + 3) + samples * (size + 3);
    let bytes = numbers * size_of::<f64>() as u128;
    memory::check(
        "hold",
        hold,
        bytes,
        Some(MAX_BYTES),
        "a larger one or a shorter horizon",
    )
}

/// One thing that is flown beside the undisturbed arm.
#[derive(Clone, Copy)]
enum Probe {
    /// Nothing.
    Nothing,
    /// A deviation of one entry of the state.
    State(usize),
    /// Torque of one wheel.
    Wheel(usize),
}

fn measure<T: Vector>(
    flight: &Flight<f64>,
    samples: usize,
    hold: usize,
) -> Result<Transitions, SimulationError> {
    let size = 2 * flight.coordinates();
    let intervals = samples / hold;
    let limits = flight.fixed();
    let torque = [limits.root.torque, limits.tip.torque].map(|limit| limit * TORQUE_FRACTION);
    let mut found = Transitions {
        size,
        intervals,
        hold,
        start: flight.deviation(),
        transition: vec![0.0; intervals * size * size],
        input: vec![0.0; intervals * size * 2],
        offset: Vec::with_capacity(intervals * size),
        error_state: vec![0.0; intervals * hold * size],
        error_input: vec![0.0; intervals * hold * 2],
        error_offset: Vec::with_capacity(intervals * hold),
    };
    let probes: Vec<Probe> = std::iter::once(Probe::Nothing)
        .chain((0..size).map(Probe::State))
        .chain((0..2).map(Probe::Wheel))
        .collect();
    let mut rest = flight.clone();
    let mut lanes = Flight::<T>::spread(flight);
    for k in 0..intervals {
        rest.place((k * hold) as f64, &vec![0.0; size]);
        // what nothing but the reference leads to
        let mut nominal = (Vec::new(), Vec::new());
        for group in probes.chunks(T::WIDTH) {
            let mut command = Held(WheelTorques {
                root: T::splat(0.0),
                tip: T::splat(0.0),
            });
            let mut seen = TipErrors(Vec::with_capacity(hold));
            interruption::poll();
            lanes.begin_at(&rest);
            for (lane, probe) in group.iter().enumerate() {
                match *probe {
                    Probe::Nothing => {}
                    Probe::State(entry) => {
                        let mut x = vec![0.0; size];
                        x[entry] = DEVIATION;
                        lanes.deviate(lane, &rest.motion_at(&x));
                    }
                    Probe::Wheel(0) => command.0.root.set_lane(lane, torque[0]),
                    Probe::Wheel(_) => command.0.tip.set_lane(lane, torque[1]),
                }
            }
            let mut controller = LawController::new(Source::Given(&mut command));
            T::enter(Fly {
                flight: &mut lanes,
                samples: hold,
                controller: &mut Hooked {
                    controller: &mut controller,
                    hook: Some(&mut seen),
                },
            });
            if controller.lost != 0 {
                let time = (k * hold + controller.flown) as f64 * flight.sample_period();
                return Err(SimulationError::Diverged { time });
            }
            for (lane, probe) in group.iter().enumerate() {
                let end = lanes.one(lane).deviation();
                let errors = seen.0.iter().map(|error| error.lane(lane));
                match *probe {
                    Probe::Nothing => {
                        nominal = (end, errors.collect());
                        found.offset.extend(&nominal.0);
                        found.error_offset.extend(&nominal.1);
                    }
                    Probe::State(entry) => {
                        let column = |row: usize| (k * size + row) * size + entry;
                        for (row, value) in end.iter().enumerate() {
                            found.transition[column(row)] = (value - nominal.0[row]) / DEVIATION;
                        }
                        for (i, value) in errors.enumerate() {
                            found.error_state[(k * hold + i) * size + entry] =
                                (value - nominal.1[i]) / DEVIATION;
                        }
                    }
                    Probe::Wheel(wheel) => {
                        let per = 1.0 / torque[wheel];
                        for (row, value) in end.iter().enumerate() {
                            found.input[(k * size + row) * 2 + wheel] =
                                (value - nominal.0[row]) * per;
                        }
                        for (i, value) in errors.enumerate() {
                            found.error_input[(k * hold + i) * 2 + wheel] =
                                (value - nominal.1[i]) * per;
                        }
                    }
                }
            }
        }
    }
    Ok(found)
}

/// Constant torques.
struct Held<T>(WheelTorques<T>);

impl<T: Number> Given<T> for Held<T> {
    fn torques(&mut self, _: &Flight<T>) -> WheelTorques<T> {
        self.0
    }
}

/// The error of the tip after each sample.
struct TipErrors<T>(Vec<T>);

impl<T: Number> StepHook<T> for TipErrors<T> {
    fn before(&mut self, _: &Flight<T>) {}

    fn after(&mut self, flight: &Flight<T>) {
        let error = flight.slew_error() * flight.reach() + flight.outputs().tip[0];
        self.0.push(error);
    }
}

/// State of a flight as deviation from the undeflected arm at the reference.
impl Flight<f64> {
    /// Number of coordinates.
    pub(crate) fn coordinates(&self) -> usize {
        self.body().coordinates()
    }

    /// Coordinates and rates, less the reference.
    pub(crate) fn deviation(&self) -> Vec<f64> {
        let (q, v) = self.body().state_of(self.motion());
        let reference = self.reference();
        let mut x: Vec<f64> = q.into_iter().chain(v).collect();
        let rate = x.len() / 2;
        x[0] -= reference.angle;
        x[rate] -= reference.rate;
        x
    }

    /// The motion that deviates so from the reference now.
    pub(crate) fn motion_at(&self, deviation: &[f64]) -> Motion<f64> {
        let reference = self.reference();
        let mut x = deviation.to_vec();
        let (q, v) = x.split_at_mut(deviation.len() / 2);
        q[0] += reference.angle;
        v[0] += reference.rate;
        self.body().motion_of(q, v, &self.extension())
    }
}
