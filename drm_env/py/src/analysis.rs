//! The model as matrices, laws outside the engine's loop, and whole manoeuvres.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use drm_env::Model as Engine;
use drm_env::analysis::linearization::{INPUT_NAMES, OUTPUT_NAMES};
use drm_env::analysis::prescribed::Prescribed;
use drm_env::analysis::transitions::Transitions;
use drm_env::arm::{PayloadInertia, PayloadProperties};
use drm_env::config::{ValidConfig, law_from_json};
use drm_env::control::servo::SERVO_MEMORY;
use drm_env::control::{
    KnownInertia, Law as EngineLaw, LawMemory, MEMORY_SIZE, Measurement, ServoMemory, ServoModel,
};
use drm_env::error::{ConfigError, Error};
use drm_env::hardware::sensors::MEASURED_NAMES;
use drm_env::math::rng::Seed;
use drm_env::plant::{RigidInertia, Torques};
use drm_env::reference::Extension;
use drm_env::rollout::{
    Beside, LoadedTrajectory, Pilot, SIGNAL_NAMES, TOLD_NAMES as MEASUREMENTS, fly_one_loaded,
};
use drm_env::simulation::loads::{LOAD_NAMES, LoadMetrics};
use drm_env::simulation::metrics::METRIC_NAMES;
use drm_env::simulation::servo_model;
use drm_env::{env, interruption, memory, rollout as flights};
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;

use crate::arrays::{Count, In1, In2, Out1, Out2};
use crate::config::{Config, Flyable, LegRow, Manoeuvre, leg_rows};
use crate::env::flown_text;
use crate::error::{Outcome, check_shape, detached, guarded};

/// The arm with one payload.
#[pyclass(frozen, module = "drm_env._engine")]
pub(crate) struct Model(Engine);

fn extension(length: f64, rate: f64, accel: f64) -> Extension<f64> {
    Extension {
        length,
        rate,
        accel,
    }
}

fn triple(name: &str, values: &In1<f64>) -> Outcome<[f64; 3]> {
    check_shape(name, values.shape(), &[3])?;
    let values = values.slice();
    Ok([values[0], values[1], values[2]])
}

/// A matrix from its entries at row and column.
fn dense<'py>(
    py: Python<'py>,
    shape: (usize, usize),
    at: impl Fn(usize, usize) -> f64,
) -> Out2<'py, f64> {
    let rows = (0..shape.0).flat_map(|i| (0..shape.1).map(move |j| (i, j)));
    let values: Vec<f64> = rows.map(|(i, j)| at(i, j)).collect();
    Out2::new(py, shape, values)
}

#[pymethods]
impl Model {
    #[new]
    fn new(spec: &str) -> Outcome<Self> {
        guarded(|| Engine::from_json(spec).map(Self))
    }

    /// M, C and K at an extension, its rate and acceleration, and a slew rate.
    #[allow(clippy::type_complexity)]
    fn matrices<'py>(
        &self,
        py: Python<'py>,
        length: f64,
        rate: f64,
        accel: f64,
        slew_rate: f64,
    ) -> Outcome<(Out2<'py, f64>, Out2<'py, f64>, Out2<'py, f64>)> {
        let at = extension(length, rate, accel);
        let [m, c, k] = detached(py, || self.0.matrices(&at, slew_rate))?;
        Ok((
            dense(py, m.shape(), |i, j| m[(i, j)]),
            dense(py, c.shape(), |i, j| c[(i, j)]),
            dense(py, k.shape(), |i, j| k[(i, j)]),
        ))
    }

    /// q'' at an extension (length, rate, acceleration) under (slew, root, tip) torques.
    fn acceleration<'py>(
        &self,
        py: Python<'py>,
        q: In1<f64>,
        q_rate: In1<f64>,
        at: (f64, f64, f64),
        torques: (f64, f64, f64),
    ) -> Outcome<Out1<'py, f64>> {
        let (q, v) = (triple("q", &q)?, triple("q_rate", &q_rate)?);
        let (slew, root, tip) = torques;
        let values = guarded(|| {
            let at = extension(at.0, at.1, at.2);
            self.0.acceleration(&at, q, v, &Torques { slew, root, tip })
        })?;
        Ok(Out1::vector(py, values.to_vec()))
    }

    /// Kinetic, potential and total energy.
    fn energy(
        &self,
        q: In1<f64>,
        q_rate: In1<f64>,
        length: f64,
        rate: f64,
    ) -> Outcome<(f64, f64, f64)> {
        let (q, v) = (triple("q", &q)?, triple("q_rate", &q_rate)?);
        let energy = guarded(|| self.0.energy(&extension(length, rate, 0.0), q, v))?;
        Ok((energy.kinetic, energy.potential, energy.total()))
    }

    /// Angular momentum about the shoulder.
    fn angular_momentum(
        &self,
        q: In1<f64>,
        q_rate: In1<f64>,
        length: f64,
        rate: f64,
    ) -> Outcome<f64> {
        let (q, v) = (triple("q", &q)?, triple("q_rate", &q_rate)?);
        guarded(|| self.0.angular_momentum(&extension(length, rate, 0.0), q, v))
    }

    /// Elastic angular frequencies, rising, rad/s.
    #[pyo3(signature = (length, count))]
    fn natural_frequencies<'py>(
        &self,
        py: Python<'py>,
        length: f64,
        count: Option<usize>,
    ) -> Outcome<Out1<'py, f64>> {
        let found = detached(py, || self.0.natural_frequencies(length, count))?;
        Ok(Out1::vector(py, found))
    }

    /// Angular frequencies, kinds, energy shares of bending in the plane, out of it and torsion,
    /// positions, and displacements in the plane, out of it and twists, a mode a row.
    #[allow(clippy::type_complexity)]
    #[pyo3(signature = (length, count))]
    fn spatial_modes<'py>(
        &self,
        py: Python<'py>,
        length: f64,
        count: Option<usize>,
    ) -> Outcome<(
        Out1<'py, f64>,
        Vec<&'static str>,
        Out2<'py, f64>,
        Out1<'py, f64>,
        (Out2<'py, f64>, Out2<'py, f64>, Out2<'py, f64>),
    )> {
        let found = detached(py, || self.0.spatial_modes(length, count))?;
        let shape = (found.shapes.len(), found.positions.len());
        let part = |i: usize| {
            let rows = found.shapes.iter().flat_map(|shape| &shape[i]);
            Out2::new(py, shape, rows.copied().collect())
        };
        let shapes = (part(0), part(1), part(2));
        let kinds = found.kinds();
        Ok((
            Out1::vector(py, found.frequencies),
            kinds,
            Out2::matrix(py, found.shares),
            Out1::vector(py, found.positions),
            shapes,
        ))
    }

    /// Distances from the shoulder, displacements (a mode a row), angular frequencies (rad/s).
    #[allow(clippy::type_complexity)]
    #[pyo3(signature = (length, count))]
    fn mode_shapes<'py>(
        &self,
        py: Python<'py>,
        length: f64,
        count: Option<usize>,
    ) -> Outcome<(Out1<'py, f64>, Out2<'py, f64>, Out1<'py, f64>)> {
        let found = detached(py, || self.0.mode_shapes(length, count))?;
        let shape = (found.displacements.len(), found.positions.len());
        Ok((
            Out1::vector(py, found.positions),
            Out2::new(py, shape, found.displacements.concat()),
            Out1::vector(py, found.frequencies),
        ))
    }

    /// A, B and C about the undeflected arm; names of states, inputs and outputs.
    #[allow(clippy::type_complexity)]
    fn linearize<'py>(
        &self,
        py: Python<'py>,
        length: f64,
        rate: f64,
        accel: f64,
        slew_rate: f64,
    ) -> Outcome<(
        (Out2<'py, f64>, Out2<'py, f64>, Out2<'py, f64>),
        (Vec<String>, Vec<&'static str>, Vec<&'static str>),
    )> {
        let at = extension(length, rate, accel);
        let found = detached(py, || self.0.linearize(&at, slew_rate))?;
        Ok((
            (
                dense(py, found.a.shape(), |i, j| found.a[(i, j)]),
                dense(py, found.b.shape(), |i, j| found.b[(i, j)]),
                dense(py, found.c.shape(), |i, j| found.c[(i, j)]),
            ),
            (found.states, INPUT_NAMES.to_vec(), OUTPUT_NAMES.to_vec()),
        ))
    }
}

/// Names of what a law is told, as in the observation.
#[pyfunction]
pub(crate) fn measurement_names() -> Vec<&'static str> {
    MEASUREMENTS.to_vec()
}

/// A control law flown once a control period.
#[pyclass(frozen, module = "drm_env._engine")]
pub(crate) struct Law {
    law: EngineLaw,
    config: ValidConfig,
    models: Mutex<HashMap<[u64; 3], Arc<ServoModel<f64>>>>,
}

/// Payloads whose models are kept.
const KEPT_MODELS: usize = 4096;

#[pymethods]
impl Law {
    #[new]
    fn new(law: &str, config: &Config) -> Outcome<Self> {
        guarded(|| {
            let law = law_from_json(law)?;
            if let Some(share) = law.needs_model().and_then(|servo| servo.lean) {
                let requirement = "must be null where the manoeuvre ahead is not known; simulate, \
                                   rollout and environments know it";
                return Err(ConfigError::value("law.lean", requirement, share));
            }
            Ok::<_, ConfigError>(Self {
                law,
                config: config.held().clone(),
                models: Mutex::default(),
            })
        })
    }

    /// Time between two calls, s.
    #[getter]
    fn control_period(&self) -> f64 {
        self.config.task.control_period
    }

    /// Whether it feeds back what the gyro at the tip wheel measures, which no observation holds.
    #[getter]
    fn needs_tip_rate(&self) -> bool {
        self.law.needs_tip_rate()
    }

    /// Torque limits of root and tip wheel, N m.
    #[getter]
    fn torque_limits(&self) -> (f64, f64) {
        let scenario = &self.config.scenario;
        (
            scenario.root_wheel.torque_limit,
            scenario.tip_wheel.torque_limit,
        )
    }

    /// Torques of root and tip wheel, N m, and the new memory, a row for each of the laws.
    fn torques<'py>(
        &self,
        py: Python<'py>,
        measurements: In2<f64>,
        state: In2<f64>,
        start: In1<bool>,
    ) -> Outcome<(Out2<'py, f64>, Out2<'py, f64>)> {
        let n = start.shape()[0];
        check_shape(
            "measurements",
            measurements.shape(),
            &[n, MEASUREMENTS.len()],
        )?;
        check_shape("state", state.shape(), &[n, MEMORY_SIZE])?;
        let rows = measurements.slice().as_chunks::<{ MEASUREMENTS.len() }>().0;
        let memories = state.slice().as_chunks::<MEMORY_SIZE>().0;
        let start = start.slice();
        let (torques, memory): (Vec<_>, Vec<_>) = detached(py, || {
            let one = |((row, memory), &start)| {
                interruption::poll();
                self.one(row, memory, start)
            };
            Ok::<_, Error>(rows.iter().zip(memories).zip(start).map(one).unzip())
        })?;
        Ok((Out2::matrix(py, torques), Out2::matrix(py, memory)))
    }
}

impl Law {
    fn one(
        &self,
        row: &[f64; MEASUREMENTS.len()],
        memory: &[f64; MEMORY_SIZE],
        start: bool,
    ) -> ([f64; 2], [f64; MEMORY_SIZE]) {
        let &[
            slew_error,
            slew_error_rate,
            deflection,
            deflection_rate,
            extension,
            extension_rate,
            reference_rate,
            reference_accel,
            slew_torque,
            root_momentum,
            tip_momentum,
            mass,
            length,
            width,
            tip_turn_rate,
            ..,
        ] = row;
        let measured = Measurement {
            slew_error,
            slew_error_rate,
            link2_deflection: deflection,
            link2_deflection_rate: deflection_rate,
            extension,
            extension_rate,
            reference_rate,
            reference_accel,
            slew_torque,
            root_momentum,
            tip_momentum,
            tip_turn_rate,
        };
        let scenario = &self.config.scenario;
        let inertia: PayloadInertia = scenario.payload.inertia;
        let reported = PayloadProperties::new(mass, length, width, inertia);
        let whole = RigidInertia::new(&scenario.arm, &reported).coefficients();
        let known = KnownInertia::new(&scenario.arm, &reported, whole);
        let mut memory = if start {
            LawMemory::fresh()
        } else {
            LawMemory {
                slew_error_rate: memory[0],
                link2_deflection_rate: memory[1],
                started: memory[2],
                servo: memory[3..]
                    .first_chunk()
                    .map_or_else(ServoMemory::fresh, ServoMemory::from_numbers),
                filters: memory
                    .last_chunk()
                    .map_or([[0.0; 2]; 2], |&[a, b, c, d]| [[a, b], [c, d]]),
            }
        };
        let model = self.model(&reported);
        let torques = self.law.torques(
            &measured,
            &known,
            model.as_deref(),
            &mut memory,
            self.config.task.control_period,
        );
        ([torques.root, torques.tip], {
            let mut row = [0.0; MEMORY_SIZE];
            row[..3].copy_from_slice(&[
                memory.slew_error_rate,
                memory.link2_deflection_rate,
                memory.started,
            ]);
            let (servo, filters) = row[3..].split_at_mut(SERVO_MEMORY);
            servo.copy_from_slice(&memory.servo.numbers());
            filters.copy_from_slice(memory.filters.as_flattened());
            row
        })
    }

    /// The model of a law that wants one, made once for each payload; none where there cannot be one.
    fn model(&self, reported: &PayloadProperties) -> Option<Arc<ServoModel<f64>>> {
        let servo = self.law.needs_model()?;
        let key = [reported.mass, reported.length, reported.width].map(f64::to_bits);
        let mut models = self.models.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(model) = models.get(&key) {
            return Some(Arc::clone(model));
        }
        let model = Arc::new(servo_model(&self.config.scenario, reported, servo).ok()?);
        if models.len() == KEPT_MODELS {
            models.clear();
        }
        models.insert(key, Arc::clone(&model));
        Some(model)
    }
}

/// Names of the signals of a trajectory.
#[pyfunction]
pub(crate) fn signal_names() -> Vec<&'static str> {
    SIGNAL_NAMES.to_vec()
}

/// Names of what is measured, in the engine's order.
#[pyfunction]
pub(crate) fn measured_names() -> Vec<&'static str> {
    MEASURED_NAMES.to_vec()
}

/// Names of the loads, in the engine's order.
#[pyfunction]
pub(crate) fn load_names() -> Vec<&'static str> {
    LOAD_NAMES.to_vec()
}

/// Flies one manoeuvre under a law: the signals, every `every`-th sample, the metrics, with `loads` these
/// among the signals and their peaks and root mean squares, with `sensors` what is measured.
#[pyfunction]
#[pyo3(signature = (scenario, law, every, seed, loads=false, sensors=false))]
#[allow(clippy::type_complexity)]
pub(crate) fn simulate<'py>(
    py: Python<'py>,
    scenario: Manoeuvre,
    law: &str,
    every: Count,
    seed: &[u8],
    loads: bool,
    sensors: bool,
) -> Outcome<(
    Vec<(&'static str, Out1<'py, f64>)>,
    Vec<(&'static str, f64)>,
    Option<(Out1<'py, f64>, Out1<'py, f64>)>,
    Vec<LegRow>,
)> {
    let beside = Beside {
        loads,
        measured: sensors,
    };
    let (flown, legs) = detached(py, || {
        let seed = Seed::from_le_bytes(seed);
        match scenario.flyable(None)? {
            Flyable::Scenario(scenario) => {
                let law = law_from_json(law)?;
                let flown = if loads || sensors {
                    fly_one_loaded(&scenario, &Pilot::law(&law)?, every.0, seed, beside)?
                } else {
                    let flown = flights::simulate(*scenario, &law, every.0, seed)?;
                    LoadedTrajectory {
                        signals: SIGNAL_NAMES.into_iter().zip(flown.signals).collect(),
                        metrics: flown.metrics,
                        loads: LoadMetrics::VOID,
                    }
                };
                Ok::<_, Error>((flown, Vec::new()))
            }
            Flyable::Mission(mission) => {
                let law = law_from_json(law)?;
                let pilot = Pilot::law(&law)?;
                let (flown, legs) =
                    flights::fly_one_mission(&mission, &pilot, every.0, seed, beside)?;
                Ok((flown, leg_rows(mission.mission(), &legs)))
            }
        }
    })?;
    let signals = flown.signals.into_iter();
    let metrics = METRIC_NAMES.into_iter().zip(flown.metrics.values());
    Ok((
        signals
            .map(|(name, values)| (name, Out1::vector(py, values)))
            .collect(),
        metrics.collect(),
        loads.then(|| {
            [flown.loads.peak, flown.loads.rms]
                .map(|x| Out1::vector(py, x.to_vec()))
                .into()
        }),
        legs,
    ))
}

/// The discrete linear model of a manoeuvre every `hold` samples: size of the state, number of
/// intervals, and flat arrays in the order of the engine's `Transitions`.
#[pyfunction]
#[allow(clippy::type_complexity)]
pub(crate) fn transitions<'py>(
    py: Python<'py>,
    scenario: Manoeuvre,
    hold: Count,
) -> Outcome<(usize, usize, Vec<Out1<'py, f64>>)> {
    let found = detached(py, || {
        let scenario = scenario.scenario(None)?;
        Transitions::of(scenario, hold.0)
    })?;
    let arrays = [
        found.start,
        found.transition,
        found.input,
        found.offset,
        found.error_state,
        found.error_input,
        found.error_offset,
    ];
    let arrays = arrays.map(|values| Out1::vector(py, values));
    Ok((found.size, found.intervals, arrays.into()))
}

/// What a manoeuvre prescribes: final time of the slew (s), its largest acceleration (rad/s^2), the
/// instants at which an acceleration changes its formula (s), and for each of the times (s) a row with
/// angle, rate and acceleration of the reference and length, rate and acceleration of the extension.
#[pyfunction]
#[allow(clippy::type_complexity)]
pub(crate) fn prescribed<'py>(
    py: Python<'py>,
    scenario: Manoeuvre,
    times: In1<f64>,
) -> Outcome<(f64, f64, Vec<f64>, Out2<'py, f64>)> {
    let times = times.slice();
    let found = detached(py, || {
        Ok::<_, Error>(Prescribed::of(scenario.scenario(None)?, times)?)
    })?;
    Ok((
        found.final_time,
        found.largest_accel,
        found.switches,
        Out2::matrix(py, found.motion),
    ))
}

/// The manoeuvres that environments fly in the first episode of each seed, as a JSON list.
#[pyfunction]
pub(crate) fn sample_scenarios(
    py: Python<'_>,
    config: &Config,
    seeds: Vec<PyBackedBytes>,
) -> Outcome<String> {
    let config = config.held();
    detached(py, || {
        let seeds: Vec<Seed> = seeds.iter().map(|seed| Seed::from_le_bytes(seed)).collect();
        let scenarios = env::sample_scenarios(config, &seeds)?;
        let text = |scenario| {
            interruption::poll();
            flown_text(config, scenario)
        };
        let texts: Vec<String> = scenarios.iter().map(text).collect();
        Ok::<_, Error>(format!("[{}]", texts.join(",")))
    })
}

/// Refuses a number of things, `each` so many bytes, that does not fit into memory; `less` is what takes
/// less.
#[pyfunction]
pub(crate) fn check_memory(name: &str, count: Count, each: usize, less: &str) -> Outcome<()> {
    let bytes = count.0 as u128 * each as u128;
    guarded(|| memory::check(name, count.0, bytes, None, less))
}
