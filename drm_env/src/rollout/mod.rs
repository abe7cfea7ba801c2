//! Whole manoeuvres flown from end to end, under a law, under given torques or by a network that acts in an
//! environment: one with its trajectory, or many in parallel with their metrics and, if wanted, some of
//! their signals.

mod asked;
pub(crate) mod law;
mod network;
mod pilot;
mod place;
mod queue;
mod recorder;
mod trajectory;

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant};

use crate::config::mission::ValidMission;
use crate::config::scenario::{Scenario, ValidScenario};
use crate::control::Law;
use crate::env::any_pack::widths;
use crate::error::{ConfigError, Error, SimulationError};
use crate::interruption::{self, Flag};
use crate::math::rng::{Purpose, Seed, Stream};
use crate::memory;
use crate::simd::{Instructions, Narrow};
use crate::simulation::LegRecord;
use crate::simulation::loads::LoadMetrics;
use crate::simulation::metrics::Metrics;

use place::Ended;
use queue::Queue;

pub use asked::{Asked, TOLD, TOLD_NAMES, fly_asked, fly_missions_asked};
pub use law::Schedule;
pub use pilot::Pilot;
pub use recorder::{Beside, Recording, Trajectories, recordable};
pub use trajectory::{MAX_BYTES, SIGNAL_NAMES, Trajectory, signals, signals_from, simulate};

/// How a rollout is flown.
#[derive(Debug, Clone)]
pub struct Options {
    /// Most threads; none is one for each processor.
    pub threads: Option<usize>,
    /// Instructions that the processor has; the results do not depend on them.
    pub instructions: Instructions,
    /// Signals to keep.
    pub recording: Option<Recording>,
}

impl Default for Options {
    /// Every processor, the widest instructions, no signals.
    fn default() -> Self {
        Self {
            threads: None,
            instructions: Instructions::detect(),
            recording: None,
        }
    }
}

/// What a rollout returns.
#[derive(Debug, Clone)]
pub struct Flown {
    /// Metrics, one a scenario.
    pub metrics: Vec<Metrics>,
    /// Signals, if any were to be kept.
    pub trajectories: Option<Trajectories>,
    /// Loads, one a scenario, if they were wanted.
    pub loads: Option<Vec<LoadMetrics>>,
    /// Legs flown of each mission; none of manoeuvres.
    pub legs: Vec<Vec<LegRecord>>,
}

impl Flown {
    /// Room for what these manoeuvres will return, or the missions that begin with them.
    ///
    /// # Errors
    /// See [`Trajectories::new`].
    fn room(
        scenarios: &[ValidScenario],
        missions: Option<&[ValidMission]>,
        recording: Option<&Recording>,
    ) -> Result<Self, ConfigError> {
        Ok(Self {
            metrics: vec![Metrics::default(); scenarios.len()],
            trajectories: recording
                .map(|recording| Trajectories::new(recording, scenarios))
                .transpose()?,
            loads: recording
                .filter(|recording| recording.measures_loads())
                .map(|_| vec![LoadMetrics::VOID; scenarios.len()]),
            legs: missions.map_or_else(Vec::new, |missions| vec![Vec::new(); missions.len()]),
        })
    }

    /// Takes up one that has ended.
    fn take(&mut self, index: usize, ended: Ended) {
        let Ended {
            metrics,
            kept,
            legs,
        } = ended;
        self.metrics[index] = metrics;
        if let Some(place) = self.legs.get_mut(index) {
            *place = legs;
        }
        if let Some(trajectories) = &mut self.trajectories {
            trajectories.put(index, &kept.rows);
        }
        if let (Some(all), Some(loads)) = (&mut self.loads, kept.loads) {
            all[index] = loads;
        }
    }
}

/// Longest time between two calls of `progress`, and between an interruption and its notice.
const REPORT_PERIOD: Duration = Duration::from_millis(50);

/// Results that may wait to be taken up.
const WAITING_RESULTS: usize = 256;

/// [`fly`] under a law, for the metrics alone.
///
/// # Errors
/// A scenario or law that cannot be used, and see [`fly`].
pub fn rollout(
    scenarios: &[Scenario],
    law: &Law,
    seeds: &[Seed],
    threads: Option<usize>,
    progress: impl FnMut(usize) -> bool,
) -> Result<Vec<Metrics>, Error> {
    let options = Options {
        threads,
        ..Options::default()
    };
    let scenarios = ValidScenario::all(scenarios)?;
    let flown = fly(&scenarios, &Pilot::law(law)?, seeds, &options, progress)?;
    Ok(flown.metrics)
}

/// Flies many manoeuvres in parallel, side by side in lanes and on threads; the result depends on
/// neither. `seeds` feed the sensors' noise, one a scenario. `progress` is called now and then on the
/// calling thread with the number flown and ends the work by returning false, as does who watches (see
/// [`interruption`]). A manoeuvre that diverges ends there and says so.
///
/// # Errors
/// A scenario that the pilot cannot fly, or an option that cannot be used, before anything is flown;
/// actions of a network that are not finite; an interruption.
pub fn fly(
    scenarios: &[ValidScenario],
    pilot: &Pilot<'_>,
    seeds: &[Seed],
    options: &Options,
    mut progress: impl FnMut(usize) -> bool,
) -> Result<Flown, Error> {
    fly_watched(scenarios, None, pilot, seeds, options, &mut progress)
}

/// [`fly`] for missions: their legs one after the other, each from where the last has left the arm.
/// Signals tell time and angles from the mission's beginning on.
///
/// # Errors
/// See [`fly`]; and a network whose task has other missions.
pub fn fly_missions(
    missions: &[ValidMission],
    pilot: &Pilot<'_>,
    seeds: &[Seed],
    options: &Options,
    mut progress: impl FnMut(usize) -> bool,
) -> Result<Flown, Error> {
    let all = missions.iter().map(ValidMission::base);
    let scenarios: Vec<ValidScenario> = all.collect();
    let missions = Some(missions);
    fly_watched(&scenarios, missions, pilot, seeds, options, &mut progress)
}

/// [`fly`], once for every type of `progress`: or each crate that calls it would compile it anew.
fn fly_watched(
    scenarios: &[ValidScenario],
    missions: Option<&[ValidMission]>,
    pilot: &Pilot<'_>,
    seeds: &[Seed],
    options: &Options,
    progress: &mut dyn FnMut(usize) -> bool,
) -> Result<Flown, Error> {
    pilot.check(scenarios)?;
    pilot.check_missions(missions)?;
    if let (Some(recording), Some(missions)) = (&options.recording, missions) {
        recording.check_missions(missions)?;
    }
    if seeds.len() != scenarios.len() {
        return Err(SimulationError::Length {
            name: "seeds",
            expected: scenarios.len(),
            got: seeds.len(),
        }
        .into());
    }
    let instructions = options.instructions;
    if instructions > Instructions::detect() {
        let requirement = "must be instructions that the processor has";
        return Err(ConfigError::value("instructions", requirement, instructions.name()).into());
    }
    let each = size_of::<(Scenario, Seed, Metrics)>();
    let bytes = scenarios.len() as u128 * each as u128;
    memory::check(
        "scenarios",
        scenarios.len(),
        bytes,
        Some(MAX_BYTES),
        "a smaller number",
    )?;
    let recording = options.recording.as_ref();
    let mut flown = Flown::room(scenarios, missions, recording)?;
    let available = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = options.threads.unwrap_or(available);
    let threads = threads.max(1).min(scenarios.len());
    let each = scenarios.len().div_ceil(threads.max(1));
    let width = widths(each, instructions).first().copied();
    let (stop, next) = (AtomicBool::new(false), AtomicUsize::new(0));
    let mut failure = None;
    std::thread::scope(|scope| {
        let (done, finished) = sync_channel(WAITING_RESULTS);
        for thread in 0..threads {
            let queue = Queue {
                scenarios,
                missions,
                seeds,
                instruments: pilot.instruments(),
                recording,
                next: &next,
                stop: &stop,
                done: done.clone(),
            };
            let builder = std::thread::Builder::new().name(format!("rollout-{thread}"));
            let fly = move || match width {
                #[cfg(target_arch = "x86_64")]
                Some(8) => pilot.fly::<crate::simd::x86::Wide8>(&queue),
                #[cfg(target_arch = "x86_64")]
                Some(4) => pilot.fly::<crate::simd::x86::Wide4>(&queue),
                Some(2) => pilot.fly::<Narrow>(&queue),
                _ => pilot.fly::<f64>(&queue),
            };
            let flag = Flag::of(&stop);
            let started = builder.spawn_scoped(scope, move || {
                // who has raised the flag knows why
                let _ = flag.heed(fly);
            });
            if started.is_err() && thread == 0 {
                let requirement = "could not be started by the system";
                failure = Some(ConfigError::value("num_threads", requirement, threads).into());
            }
        }
        drop(done);
        failure = failure
            .take()
            .or(collect(&finished, &stop, &mut flown, progress));
    });
    match failure {
        Some(error) => Err(error),
        None => Ok(flown),
    }
}

/// Flies one manoeuvre on the calling thread and keeps all its signals, every `every`-th sample, the first
/// and the last included: the numbers are those of [`fly`]. It starts no thread and asks for no time, so
/// that it works where there is neither. `seed` feeds the sensors' noise.
///
/// # Errors
/// See [`fly`].
pub fn fly_one(
    scenario: &ValidScenario,
    pilot: &Pilot<'_>,
    every: usize,
    seed: Seed,
) -> Result<Trajectory, Error> {
    let recording = Recording::new(&SIGNAL_NAMES, every)?;
    let Ended { metrics, kept, .. } = fly_here(scenario, pilot, &recording, seed)?;
    Ok(Trajectory::of_rows(&kept.rows, metrics))
}

/// One manoeuvre with what is wanted beside its signals.
#[derive(Debug, Clone)]
pub struct LoadedTrajectory {
    /// Names with their values, SI, angles in radians: the signals, loads and measurements.
    pub signals: Vec<(&'static str, Vec<f64>)>,
    /// Metrics of the manoeuvre.
    pub metrics: Metrics,
    /// Its loads, if they are wanted.
    pub loads: LoadMetrics,
}

/// [`fly_one`] with loads or measurements beside the signals.
///
/// # Errors
/// See [`fly`].
pub fn fly_one_loaded(
    scenario: &ValidScenario,
    pilot: &Pilot<'_>,
    every: usize,
    seed: Seed,
    beside: Beside,
) -> Result<LoadedTrajectory, Error> {
    let names = beside.names();
    let recording = beside.recording(every)?;
    let Ended { metrics, kept, .. } = fly_here(scenario, pilot, &recording, seed)?;
    let column = |first| kept.rows.iter().skip(first).step_by(names.len()).copied();
    let signals = names.iter().enumerate();
    Ok(LoadedTrajectory {
        signals: signals
            .map(|(i, name)| (*name, column(i).collect()))
            .collect(),
        metrics,
        loads: kept.loads.unwrap_or(LoadMetrics::VOID),
    })
}

/// One manoeuvre on the calling thread.
fn fly_here(
    scenario: &ValidScenario,
    pilot: &Pilot<'_>,
    recording: &Recording,
    seed: Seed,
) -> Result<Ended, Error> {
    let scenarios = std::slice::from_ref(scenario);
    pilot.check_one(scenario)?;
    // for its check of the size
    Trajectories::new(recording, scenarios)?;
    let (done, finished) = sync_channel(1);
    pilot.fly::<f64>(&Queue {
        scenarios,
        missions: None,
        seeds: &[seed],
        instruments: pilot.instruments(),
        recording: Some(recording),
        next: &AtomicUsize::new(0),
        stop: &AtomicBool::new(false),
        done,
    });
    let (_, ended) = finished
        .try_recv()
        .map_err(|_| SimulationError::Interrupted)?;
    ended
}

/// Flies one mission and keeps every signal of every `every`-th sample, as [`fly_one`] does a manoeuvre,
/// with what is wanted beside them; also what has been of its legs.
///
/// # Errors
/// See [`fly_missions`].
pub fn fly_one_mission(
    mission: &ValidMission,
    pilot: &Pilot<'_>,
    every: usize,
    seed: Seed,
    beside: Beside,
) -> Result<(LoadedTrajectory, Vec<LegRecord>), Error> {
    let recording = beside.recording(every)?;
    let options = Options {
        threads: Some(1),
        recording: Some(recording),
        ..Options::default()
    };
    let flown = fly_missions(
        std::slice::from_ref(mission),
        pilot,
        &[seed],
        &options,
        |_| true,
    )?;
    let Flown {
        metrics,
        trajectories,
        loads,
        legs,
    } = flown;
    let mut signals = trajectories.map_or_else(Vec::new, |kept| kept.signals);
    let rows = signals.first().map_or(0, |(_, values)| {
        let flown = values.iter().rposition(|value| !value.is_nan());
        flown.map_or(0, |last| last + 1)
    });
    for (_, values) in &mut signals {
        values.truncate(rows);
    }
    let flown = LoadedTrajectory {
        signals,
        metrics: metrics.first().copied().unwrap_or_default(),
        loads: loads.map_or(LoadMetrics::VOID, |loads| loads[0]),
    };
    Ok((flown, legs.into_iter().next().unwrap_or_default()))
}

/// Takes results up until every thread has ended; the first failure, if there was one.
fn collect(
    finished: &std::sync::mpsc::Receiver<queue::Report>,
    stop: &AtomicBool,
    flown: &mut Flown,
    progress: &mut dyn FnMut(usize) -> bool,
) -> Option<Error> {
    let mut failure = None;
    let mut count = 0;
    let mut reported = Instant::now();
    loop {
        match finished.recv_timeout(REPORT_PERIOD) {
            Ok((index, Ok(ended))) => {
                flown.take(index, ended);
                count += 1;
            }
            Ok((_, Err(error))) => {
                stop.store(true, Ordering::Relaxed);
                failure.get_or_insert(error);
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
        if reported.elapsed() >= REPORT_PERIOD {
            reported = Instant::now();
            let stopped = stop.load(Ordering::Relaxed);
            if !stopped && (!progress(count) || interruption::is_wanted()) {
                stop.store(true, Ordering::Relaxed);
                failure.get_or_insert(SimulationError::Interrupted.into());
            }
        }
    }
    if failure.is_none() {
        progress(count);
    }
    failure
}

/// The sensors' noise of a manoeuvre: that of an environment's first episode with this seed.
fn noise(seed: Seed) -> Stream {
    Stream::new(seed, 0, Purpose::Sensors)
}
