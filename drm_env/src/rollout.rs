//! Whole closed-loop manoeuvres without an environment around them: one with its trajectory, or
//! many in parallel with their metrics.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::batch::Pool;
use crate::control::{Law, WheelTorques};
use crate::error::{ConfigError, Error, SimulationError};
use crate::flight::{Flight, Plan};
use crate::metrics::Metrics;
use crate::rng::{Purpose, Seed, Stream};
use crate::scenario::Scenario;

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

/// Signals over the time of one manoeuvre, SI, angles in radians.
#[derive(Debug, Clone)]
pub struct Trajectory {
    /// One list a signal, in the order of [`SIGNAL_NAMES`].
    pub signals: [Vec<f64>; SIGNAL_NAMES.len()],
    /// Metrics of the manoeuvre.
    pub metrics: Metrics,
}

/// Signals at the present instant; `torques` are slew motor, root and tip wheel, N m.
pub fn signals(flight: &Flight, torques: [f64; 3]) -> [f64; SIGNAL_NAMES.len()] {
    let reference = flight.reference();
    let extension = flight.extension();
    let [theta, alpha, beta] = flight.position();
    let [theta_rate, alpha_rate, beta_rate] = flight.velocity();
    let [slew, root, tip] = torques;
    let [root_momentum, tip_momentum] = flight.wheel_momentum();
    let motor = flight.plan().scenario.slew_motor.constants;
    [
        flight.time(),
        theta,
        theta_rate,
        reference.angle,
        reference.rate,
        reference.accel,
        alpha,
        beta,
        alpha_rate,
        beta_rate,
        flight.tip_deflection().0,
        2.0 * beta,
        extension.length,
        extension.rate,
        slew,
        root,
        tip,
        root_momentum,
        tip_momentum,
        motor.power(slew, reference.rate, reference.accel),
    ]
}

fn noise(seed: Seed) -> Stream {
    Stream::new(seed, 0, Purpose::Sensors)
}

/// Flies one manoeuvre under a law and keeps every `every`-th sample, the first and last included.
/// `seed` feeds the sensors' noise.
///
/// # Errors
/// A scenario or law that cannot be used; a state that is no longer finite.
pub fn simulate(
    scenario: &Scenario,
    law: &Law,
    every: usize,
    seed: Seed,
) -> Result<Trajectory, Error> {
    if every == 0 {
        return Err(ConfigError::value("every", "must be at least 1", every).into());
    }
    law.validate()?;
    let mut flight = Flight::new(Plan::new(scenario)?, noise(seed));
    let samples = scenario.samples();
    let mut kept: [Vec<f64>; SIGNAL_NAMES.len()] =
        std::array::from_fn(|_| Vec::with_capacity(samples / every + 2));
    let mut keep = |row: [f64; SIGNAL_NAMES.len()]| {
        for (list, value) in kept.iter_mut().zip(row) {
            list.push(value);
        }
    };
    for sample in 0..samples {
        let command = flight.law_torques(law);
        // the torques of a row are those applied from it on
        let before = (sample % every == 0).then(|| signals(&flight, [0.0; 3]));
        flight.advance(&command, None);
        if let Some(mut row) = before {
            let [slew, root, tip] = flight.last_torques();
            row[14..17].copy_from_slice(&[slew, root, tip]);
            let motor = scenario.slew_motor.constants;
            row[19] = motor.power(slew, row[4], row[5]);
            keep(row);
        }
        check_finite(&flight, 0)?;
    }
    let [_, root, tip] = flight.last_torques();
    let slew = flight.plan().slew_torque(flight.time());
    keep(signals(&flight, [slew, root, tip]));
    let metrics = flight.metrics(false, 0.0);
    Ok(Trajectory {
        signals: kept,
        metrics,
    })
}

/// Flies one manoeuvre for its metrics alone. One that diverges ends there and says so.
fn fly(scenario: &Scenario, law: &Law, seed: Seed) -> Result<Metrics, ConfigError> {
    let mut flight = Flight::new(Plan::new(scenario)?, noise(seed));
    for _ in 0..scenario.samples() {
        let command: WheelTorques<f64> = flight.law_torques(law);
        flight.advance(&command, None);
        if !flight.is_finite() {
            return Ok(flight.metrics(true, 0.0));
        }
    }
    Ok(flight.metrics(false, 0.0))
}

/// Flies many manoeuvres in parallel; the result does not depend on the threads. `seeds` feed the
/// sensors' noise, one a scenario. `progress` is called now and then on the calling thread with the
/// number flown and ends the work by returning false.
///
/// # Errors
/// A scenario or law that cannot be used, before anything is flown; an interruption.
pub fn rollout(
    scenarios: &[Scenario],
    law: &Law,
    seeds: &[Seed],
    threads: Option<usize>,
    mut progress: impl FnMut(usize) -> bool,
) -> Result<Vec<Metrics>, Error> {
    law.validate()?;
    if seeds.len() != scenarios.len() {
        return Err(SimulationError::Length {
            name: "seeds",
            expected: scenarios.len(),
            got: seeds.len(),
        }
        .into());
    }
    for (i, scenario) in scenarios.iter().enumerate() {
        scenario
            .validate()
            .map_err(|e| e.within(&format!("scenarios[{i}]")))?;
    }
    let available = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = threads.unwrap_or(available).max(1);
    let mut pool = Pool::default();
    let pool = pool.get(threads).ok_or_else(|| {
        ConfigError::value("num_threads", "could not be started by the system", threads)
    })?;
    let (flown, stop) = (AtomicUsize::new(0), AtomicBool::new(false));
    let (done, finished) = std::sync::mpsc::channel();
    let mut result = None;
    std::thread::scope(|scope| {
        let (flown, stop) = (&flown, &stop);
        scope.spawn(move || {
            let metrics: Result<Vec<Metrics>, Option<ConfigError>> = pool.install(|| {
                scenarios
                    .par_iter()
                    .zip(seeds)
                    .with_max_len(16)
                    .map(|(scenario, &seed)| {
                        if stop.load(Ordering::Relaxed) {
                            return Err(None);
                        }
                        let metrics = fly(scenario, law, seed).map_err(Some)?;
                        flown.fetch_add(1, Ordering::Relaxed);
                        Ok(metrics)
                    })
                    .collect()
            });
            // the receiver waits until this arrives
            let _ = done.send(metrics);
        });
        let pause = std::time::Duration::from_millis(50);
        loop {
            match finished.recv_timeout(pause) {
                Ok(metrics) => {
                    result = Some(metrics);
                    break;
                }
                Err(std::sync::mpsc::RecvTimeoutError::Timeout) => {
                    if !progress(flown.load(Ordering::Relaxed)) {
                        stop.store(true, Ordering::Relaxed);
                    }
                }
                Err(std::sync::mpsc::RecvTimeoutError::Disconnected) => break,
            }
        }
    });
    match result {
        Some(Ok(metrics)) => {
            progress(metrics.len());
            Ok(metrics)
        }
        Some(Err(Some(error))) => Err(error.into()),
        Some(Err(None)) | None => Err(SimulationError::Interrupted.into()),
    }
}

fn check_finite(flight: &Flight, index: usize) -> Result<(), SimulationError> {
    if flight.is_finite() {
        return Ok(());
    }
    Err(SimulationError::Diverged {
        time: flight.time(),
        index,
    })
}
