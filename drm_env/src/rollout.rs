//! Whole closed-loop manoeuvres without an environment around them: one with its trajectory, or
//! many in parallel with their metrics.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crate::control::{Law, WheelTorques};
use crate::crew::widths;
use crate::error::{ConfigError, Error, SimulationError};
use crate::flight::{Flight, Fly, Pilot, Plan};
use crate::lane::{Instructions, Number, Pack};
use crate::metrics::Metrics;
use crate::rng::{Purpose, Seed, Stream};
use crate::scenario::Scenario;
use crate::vector::Vector;

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
        flight.motor_power(slew),
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
    let mut flight = Flight::new(Plan::new(scenario)?, noise(seed))?;
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
    let slew = flight.slew_torque();
    keep(signals(&flight, [slew, root, tip]));
    let metrics = flight.metrics(false, 0.0);
    Ok(Trajectory {
        signals: kept,
        metrics,
    })
}

/// Flies many manoeuvres in parallel, side by side in lanes and on threads; the result depends on
/// neither. `seeds` feed the sensors' noise, one a scenario. `progress` is called now and then on the
/// calling thread with the number flown and ends the work by returning false. A manoeuvre that
/// diverges ends there and says so.
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
    let threads = threads.unwrap_or(available).max(1).min(scenarios.len());
    let (stop, next) = (AtomicBool::new(false), AtomicUsize::new(0));
    let mut metrics = vec![Metrics::default(); scenarios.len()];
    let mut failure = None;
    std::thread::scope(|scope| {
        let (done, finished) = std::sync::mpsc::channel();
        let each = scenarios.len().div_ceil(threads.max(1));
        let width = widths(each, Instructions::detect()).first().copied();
        for thread in 0..threads {
            let queue = Queue {
                scenarios,
                seeds,
                next: &next,
                stop: &stop,
                done: done.clone(),
            };
            let builder = std::thread::Builder::new().name(format!("rollout-{thread}"));
            let started = builder.spawn_scoped(scope, move || match width {
                #[cfg(target_arch = "x86_64")]
                Some(8) => queue.fly::<crate::lane::wide::Wide8>(law),
                #[cfg(target_arch = "x86_64")]
                Some(4) => queue.fly::<crate::lane::wide::Wide4>(law),
                Some(2) => queue.fly::<Pack<2>>(law),
                _ => queue.fly::<f64>(law),
            });
            if started.is_err() && thread == 0 {
                let requirement = "could not be started by the system";
                failure = Some(ConfigError::value("num_threads", requirement, threads).into());
            }
        }
        drop(done);
        let pause = std::time::Duration::from_millis(50);
        let mut flown = 0;
        let mut reported = std::time::Instant::now();
        loop {
            match finished.recv_timeout(pause) {
                Ok((index, Ok(result))) => {
                    metrics[index] = result;
                    flown += 1;
                }
                Ok((index, Err(error))) => {
                    stop.store(true, Ordering::Relaxed);
                    let error: ConfigError = error;
                    failure.get_or_insert(error.within(&format!("scenarios[{index}]")).into());
                }
                Err(std::sync::mpsc::RecvTimeoutError::Timeout) => {}
                Err(std::sync::mpsc::RecvTimeoutError::Disconnected) => break,
            }
            if reported.elapsed() >= pause {
                reported = std::time::Instant::now();
                if !stop.load(Ordering::Relaxed) && !progress(flown) {
                    stop.store(true, Ordering::Relaxed);
                    failure.get_or_insert(SimulationError::Interrupted.into());
                }
            }
        }
    });
    match failure {
        Some(error) => Err(error),
        None => {
            progress(metrics.len());
            Ok(metrics)
        }
    }
}

/// What the threads of a rollout share.
struct Queue<'a> {
    scenarios: &'a [Scenario],
    seeds: &'a [Seed],
    next: &'a AtomicUsize,
    stop: &'a AtomicBool,
    done: std::sync::mpsc::Sender<(usize, Result<Metrics, ConfigError>)>,
}

/// Samples between two looks at the lanes, unless one ends before.
const SAMPLES_BETWEEN_LOOKS: usize = 256;

impl Queue<'_> {
    /// The next manoeuvre to fly.
    fn take(&self) -> Option<(usize, Flight<f64>)> {
        loop {
            if self.stop.load(Ordering::Relaxed) {
                return None;
            }
            let index = self.next.fetch_add(1, Ordering::Relaxed);
            let scenario = self.scenarios.get(index)?;
            let flight = Plan::of_valid(scenario)
                .and_then(|plan| Flight::new(plan, noise(self.seeds[index])));
            match flight {
                Ok(flight) => return Some((index, flight)),
                Err(error) => self.send(index, Err(error)),
            }
        }
    }

    fn send(&self, index: usize, result: Result<Metrics, ConfigError>) {
        // the receiver waits until every sender is gone
        let _ = self.done.send((index, result));
    }

    /// Flies manoeuvres side by side until there are no more: a lane that has ended takes the next one.
    fn fly<T: Vector>(&self, law: &Law) {
        let Some((index, first)) = self.take() else {
            return;
        };
        let mut lanes: Vec<Option<(usize, usize)>> = vec![None; T::WIDTH];
        lanes[0] = Some((index, first.scenario().samples()));
        let mut flight = Flight::<T>::spread(&first);
        let mut more = true;
        loop {
            for (lane, place) in lanes.iter_mut().enumerate() {
                while more && place.is_none() {
                    match self.take() {
                        None => more = false,
                        Some((index, next)) if flight.accepts(&next) => {
                            *place = Some((index, next.scenario().samples()));
                            flight.put(lane, &next);
                        }
                        Some((index, next)) => self.fly_one(index, next, law),
                    }
                }
            }
            let left = lanes.iter().flatten().map(|(_, left)| *left).min();
            let Some(left) = left else {
                return;
            };
            if self.stop.load(Ordering::Relaxed) {
                return;
            }
            let resting = lanes
                .iter()
                .enumerate()
                .filter(|(_, place)| place.is_none())
                .fold(0, |bits, (lane, _)| bits | 1 << lane);
            flight.rest(resting);
            let mut pilot = Autopilot {
                law,
                flown: 0,
                lost: 0,
            };
            T::enter(Fly {
                flight: &mut flight,
                samples: left.min(SAMPLES_BETWEEN_LOOKS),
                pilot: &mut pilot,
            });
            for (lane, place) in lanes.iter_mut().enumerate() {
                if let Some((index, left)) = place {
                    *left -= pilot.flown;
                    let lost = pilot.lost >> lane & 1 == 1;
                    if *left == 0 || lost {
                        let metrics = flight.one(lane).metrics(lost, 0.0);
                        self.send(*index, Ok(metrics));
                        *place = None;
                    }
                }
            }
        }
    }

    /// Flies one manoeuvre whose equations or samples are not those of the others.
    fn fly_one(&self, index: usize, mut flight: Flight<f64>, law: &Law) {
        let mut pilot = Autopilot {
            law,
            flown: 0,
            lost: 0,
        };
        let samples = flight.scenario().samples();
        f64::enter(Fly {
            flight: &mut flight,
            samples,
            pilot: &mut pilot,
        });
        self.send(index, Ok(flight.metrics(pilot.lost != 0, 0.0)));
    }
}

/// A law as the pilot, until a lane's state is no longer finite.
struct Autopilot<'a> {
    law: &'a Law,
    flown: usize,
    lost: u32,
}

impl<T: Number> Pilot<T> for Autopilot<'_> {
    #[inline(always)]
    fn command(&mut self, flight: &mut Flight<T>) -> (WheelTorques<T>, Option<T>) {
        (flight.law_torques(self.law), None)
    }

    #[inline(always)]
    fn flown(&mut self, flight: &mut Flight<T>) -> bool {
        self.flown += 1;
        self.lost = flight.outputs().not_finite().bits() & !flight.resting();
        self.lost == 0
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
