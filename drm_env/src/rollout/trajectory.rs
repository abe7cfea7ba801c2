//! The signals of a manoeuvre, and one manoeuvre with all of them.

use crate::arm::LINK_END_DEFLECTION;
use crate::config::scenario::ValidScenario;
use crate::control::Law;
use crate::error::{ConfigError, Error};
use crate::interruption;
use crate::math::rng::Seed;
use crate::memory;
use crate::simd::{Laned, Number};
use crate::simulation::clock::Clock;
use crate::simulation::metrics::Metrics;
use crate::simulation::{Flight, Plan};

use super::noise;

/// Most memory that the trajectories of one rollout may take, bytes.
pub const MAX_BYTES: u64 = 16 << 30;

/// Names of the signals of a [`Trajectory`], in order.
pub const SIGNAL_NAMES: [&str; 20] = [
    "time",
    "slew_angle",
    "slew_rate",
    "reference_angle",
    "reference_rate",
    "reference_accel",
    "alpha",
    "beta",
    "alpha_rate",
    "beta_rate",
    "tip_deflection",
    "link2_tip_deflection",
    "extension",
    "extension_rate",
    "slew_torque",
    "root_torque",
    "tip_torque",
    "root_momentum",
    "tip_momentum",
    "motor_power",
];

/// Places of some signals in [`SIGNAL_NAMES`].
const TIME: usize = 0;
const SLEW_ANGLE: usize = 1;
const REFERENCE_ANGLE: usize = 3;
const REFERENCE_RATE: usize = 4;
const REFERENCE_ACCEL: usize = 5;
const SLEW_TORQUE: usize = 14;
const MOTOR_POWER: usize = 19;

/// Every signal at one instant, in the order of [`SIGNAL_NAMES`].
pub(super) type Row = [f64; SIGNAL_NAMES.len()];

/// Signals over the time of one manoeuvre, SI, angles in radians.
#[derive(Debug, Clone)]
pub struct Trajectory {
    /// One list a signal, in the order of [`SIGNAL_NAMES`].
    pub signals: [Vec<f64>; SIGNAL_NAMES.len()],
    /// Metrics of the manoeuvre.
    pub metrics: Metrics,
}

impl Trajectory {
    /// From rows of every signal, one after the other.
    pub(super) fn of_rows(rows: &[f64], metrics: Metrics) -> Self {
        let column = |first| rows.iter().skip(first).step_by(SIGNAL_NAMES.len());
        Self {
            signals: std::array::from_fn(|first| column(first).copied().collect()),
            metrics,
        }
    }
}

/// Signals at the present instant, SI, in the order of [`SIGNAL_NAMES`]; `torques` are slew motor,
/// root and tip wheel, N m.
pub fn signals(flight: &Flight, torques: [f64; 3]) -> [f64; SIGNAL_NAMES.len()] {
    signals_of(flight, 0, torques)
}

/// [`signals`] of a flight that is a leg of a mission: place, time (s) and reference of the slew angle (rad)
/// at its beginning are zeros of a manoeuvre.
pub fn signals_from(
    flight: &Flight,
    torques: [f64; 3],
    (_, time, angle): (usize, f64, f64),
) -> [f64; SIGNAL_NAMES.len()] {
    let mut row = signals(flight, torques);
    if time != 0.0 || angle != 0.0 {
        move_row(&mut row, (time, angle));
    }
    row
}

/// [`signals`] of one lane.
pub(super) fn signals_of<T: Number>(flight: &Flight<T>, lane: usize, torques: [f64; 3]) -> Row {
    let outputs = flight.outputs().lane_of(lane);
    let clock = flight.clock().lane_of(lane);
    let mut row = [
        clock.time,
        outputs.slew[0],
        outputs.slew[1],
        clock.reference.angle,
        clock.reference.rate,
        clock.reference.accel,
        outputs.alpha[0],
        outputs.beta[0],
        outputs.alpha[1],
        outputs.beta[1],
        outputs.tip[0],
        LINK_END_DEFLECTION * outputs.beta[0],
        clock.extension.length,
        clock.extension.rate,
        0.0,
        0.0,
        0.0,
        flight.common.root.momentum.lane(lane),
        flight.common.tip.momentum.lane(lane),
        0.0,
    ];
    apply_torques(&mut row, flight, lane, torques);
    row
}

/// Replaces the torques of a row of one lane (slew motor, root and tip wheel, N m) and the motor's
/// power.
pub(super) fn apply_torques<T: Number>(
    row: &mut Row,
    flight: &Flight<T>,
    lane: usize,
    torques: [f64; 3],
) {
    row[SLEW_TORQUE..][..torques.len()].copy_from_slice(&torques);
    let motor = flight.fixed().current.lane_of(lane);
    row[MOTOR_POWER] = if flight.is_braked(lane) {
        0.0
    } else {
        motor.power(torques[0], row[REFERENCE_RATE], row[REFERENCE_ACCEL])
    };
}

/// Slew motor, root and tip wheel of a row, N m.
pub(super) fn torques_of(row: &Row) -> [f64; 3] {
    [0, 1, 2].map(|i| row[SLEW_TORQUE + i])
}

/// Tells a row of a leg from the beginning of its mission on: time (s) and reference of the slew angle
/// (rad) at the leg's beginning are added.
pub(super) fn move_row(row: &mut Row, (time, angle): (f64, f64)) {
    row[TIME] += time;
    row[SLEW_ANGLE] += angle;
    row[REFERENCE_ANGLE] += angle;
}

/// The last row of a lane: wheel torques are those of the last sample; `driven` says that so is the
/// slew motor's, which otherwise is the open loop's at this instant; and what holds the shoulder.
pub(super) fn last_row<T: Number>(flight: &Flight<T>, lane: usize, driven: bool) -> Row {
    let [slew, root, tip] = flight.common.torques.lane_of(lane);
    let slew = if driven || flight.is_held(lane) {
        slew
    } else {
        let Clock {
            reference,
            extension,
            ..
        } = flight.clock().lane_of(lane);
        let inertia = flight.fixed().inertia.lane_of(lane);
        inertia.slew_torque(&extension, reference.rate, reference.accel)
    };
    signals_of(flight, lane, [slew, root, tip])
}

/// Flies one manoeuvre under a law and keeps every `every`-th sample, the first and last included.
/// `seed` feeds the sensors' noise. A manoeuvre that leaves the limits of [`crate::validity`] ends there
/// and its metrics say so; the state beyond them is not kept.
///
/// # Errors
/// A scenario or law that cannot be used.
pub fn simulate(
    scenario: impl TryInto<ValidScenario, Error: Into<ConfigError>>,
    law: &Law,
    every: usize,
    seed: Seed,
) -> Result<Trajectory, Error> {
    let scenario = scenario.try_into().map_err(Into::into)?;
    simulate_valid(&scenario, law, every, seed)
}

/// [`simulate`], once for every crate that calls it.
fn simulate_valid(
    scenario: &ValidScenario,
    law: &Law,
    every: usize,
    seed: Seed,
) -> Result<Trajectory, Error> {
    if every == 0 {
        return Err(ConfigError::value("every", "must be at least 1", every).into());
    }
    law.validate()?;
    let mut flight = Flight::new(Plan::new(scenario)?, noise(seed))?;
    let samples = scenario.samples();
    let rows = samples / every + 2;
    let bytes = rows as u128 * size_of::<Row>() as u128;
    let less = "a larger one or a shorter horizon";
    memory::check("decimation", every, bytes, Some(MAX_BYTES), less)?;
    let between_polls = flight.samples_between_polls();
    let mut kept: [Vec<f64>; SIGNAL_NAMES.len()] =
        std::array::from_fn(|_| Vec::with_capacity(rows));
    let mut keep = |row: Row| {
        for (list, value) in kept.iter_mut().zip(row) {
            list.push(value);
        }
    };
    for sample in 0..samples {
        if sample.is_multiple_of(between_polls) {
            interruption::poll();
        }
        let command = flight.law_torques(law);
        // the torques of a row are those applied from it on
        let before = (sample % every == 0).then(|| signals(&flight, [0.0; 3]));
        flight.advance(&command, None);
        if let Some(mut row) = before {
            apply_torques(&mut row, &flight, 0, flight.last_torques());
            keep(row);
        }
        if flight.void() != 0 {
            break;
        }
    }
    if flight.void() == 0 {
        keep(last_row(&flight, 0, false));
    }
    Ok(Trajectory {
        signals: kept,
        metrics: flight.metrics(false, 0.0),
    })
}
