//! Observation, reward and limits: pure functions of what is flown. Not the integrator, not
//! randomness, not batches.

use crate::config::scenario::Scenario;
use crate::config::{EnvConfig, ObservePayload, ObservedSensor, Task};
use crate::error::ConfigError;
use crate::reference::Extension;
use crate::simd::functions::asinh;
use crate::simd::mask::lanes_of;
use crate::simd::{Laned, Number};
use crate::simulation::Flight;

/// One entry of the observation.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Name; entries of older frames carry `@-k`.
    pub name: String,
    /// Unit of the value before scaling.
    pub unit: &'static str,
    /// The observation is value / scale.
    pub scale: f64,
}

/// Every scaled entry is limited to this magnitude.
pub const OBSERVATION_LIMIT: f64 = 100.0;

/// Entries that do not depend on the configuration: name, unit, scale.
///
/// A "fine" entry is asinh(x / x0) of the entry before it, x0 in [`FINE`]; its scale is that of a
/// value at the linear entry's scale, so that both are of order one.
const FIXED: [(&str, &str, f64); 23] = [
    ("slew_error", "rad", 0.1),
    ("slew_error_fine", "-", 9.9),
    ("slew_error_rate", "rad/s", 0.02),
    ("slew_error_rate_fine", "-", 8.3),
    ("slew_angle", "rad", 1.0),
    ("slew_rate", "rad/s", 0.2),
    ("link2_deflection", "m", 0.05),
    ("link2_deflection_fine", "-", 9.2),
    ("link2_deflection_rate", "m/s", 0.5),
    ("link2_deflection_rate_fine", "-", 9.2),
    ("reference_angle", "rad", 1.0),
    ("reference_rate", "rad/s", 0.2),
    ("reference_accel", "rad/s^2", 0.02),
    ("extension", "m", 8.0),
    ("extension_rate", "m/s", 1.0),
    ("extension_accel", "m/s^2", 0.2),
    ("time_left", "s", 20.0),
    ("payload_mass", "kg", 500.0),
    ("payload_length", "m", 2.0),
    ("payload_width", "m", 1.0),
    ("slew_torque", "N m", 2000.0),
    ("root_torque", "N m", 100.0),
    ("tip_torque", "N m", 10.0),
];

/// Entries of the wheels' stored momentum: name, unit, scale.
const MOMENTUM: [(&str, &str, f64); 2] = [
    ("root_momentum", "N m s", 500.0),
    ("tip_momentum", "N m s", 50.0),
];

/// Entry of the identified payload, if it is asked for: name, unit, scale.
const IDENTIFIED: (&str, &str, f64) = ("identified_mass_error", "1", 0.1);

/// Entries of the slew error taken to the tip, if they are asked for: name, unit, scale. The scales are
/// those of the errors against which the wheels' whole torque is wanted, so that the weights of a
/// good linear policy are of order one.
const TIP_ERROR: [(&str, &str, f64); 2] = [("tip_error", "m", 0.05), ("tip_error_fine", "-", 2.0)];

/// Where the compressed error at the tip turns from linear to logarithmic, m.
const TIP_ERROR_FINE: f64 = 0.01;

/// Entries of the error of the tip without the vibration, if they are asked for: name, unit, scale. To the slew
/// error taken to the tip they add what the reference's acceleration bends of the arm as it is believed, with the
/// payload of the running estimate: link 1's deflection, which nothing measures, is in it.
const STILL: [(&str, &str, f64); 2] = [
    ("still_tip_error", "m", 0.01),
    ("still_tip_error_fine", "-", 3.0),
];

/// Where the compressed error of the still tip turns from linear to logarithmic, m.
const STILL_TIP_ERROR_FINE: f64 = 5e-4;

/// Entries of the running estimate of the payload, if they are asked for: name, unit, scale. By it the rate of
/// the error at the tip follows from the arm's angular momentum, without the vibration that the measured rate
/// has.
const ESTIMATED: [(&str, &str, f64); 3] = [
    ("estimated_mass_error", "1", 0.1),
    ("mean_tip_rate", "m/s", 0.05),
    ("mean_tip_rate_fine", "-", 2.0),
];

/// Where the compressed rate of the error at the tip turns from linear to logarithmic, m/s.
const MEAN_TIP_RATE_FINE: f64 = 0.01;

/// What the payload takes by that estimate beyond what the motor was told to give, now and at each preview
/// time: name, unit, scale.
const MISSING: (&str, &str, f64) = ("missing_torque", "N m", 100.0);

/// Entry of an instrument, if it is asked for: name, unit, scale.
const fn sensor_entry(sensor: ObservedSensor) -> (&'static str, &'static str, f64) {
    match sensor {
        ObservedSensor::Link1Gauge => ("link1_moment", "N m", 2000.0),
        ObservedSensor::Link2Gauge => ("link2_moment", "N m", 1000.0),
        ObservedSensor::TipAccelerometer => ("tip_acceleration", "m/s^2", 1.0),
        ObservedSensor::TipGyro => ("tip_turn_rate", "rad/s", 0.2),
    }
}

/// Entries of each preview time: name, unit, scale.
const PREVIEW: [(&str, &str, f64); 2] = [
    ("reference_accel", "rad/s^2", 0.02),
    ("extension", "m", 8.0),
];

/// Where the compressed entries turn from linear to logarithmic, in the unit of the entry before each.
pub const FINE: [(&str, f64); 4] = [
    ("slew_error", 1e-5),
    ("slew_error_rate", 1e-5),
    ("link2_deflection", 1e-5),
    ("link2_deflection_rate", 1e-4),
];

/// Names, units and scales of the whole observation in order; older frames first.
pub fn observation_layout(task: &Task) -> Vec<Entry> {
    let mut frame: Vec<(String, &'static str, f64)> = FIXED
        .iter()
        .chain(&MOMENTUM)
        .map(|&(name, unit, scale)| (name.to_owned(), unit, scale))
        .collect();
    if task.observe_identified {
        let (name, unit, scale) = IDENTIFIED;
        frame.push((name.to_owned(), unit, scale));
    }
    if task.observe_tip_error {
        for (name, unit, scale) in TIP_ERROR {
            frame.push((name.to_owned(), unit, scale));
        }
    }
    if task.observe_still_tip_error {
        for (name, unit, scale) in STILL {
            frame.push((name.to_owned(), unit, scale));
        }
    }
    let (missing, newton_metres, torque) = MISSING;
    if task.observe_payload_estimate {
        for (name, unit, scale) in ESTIMATED {
            frame.push((name.to_owned(), unit, scale));
        }
        frame.push((missing.to_owned(), newton_metres, torque));
    }
    for time in &task.preview_times {
        for (name, unit, scale) in PREVIEW {
            frame.push((format!("{name}+{time}s"), unit, scale));
        }
        if task.observe_payload_estimate {
            frame.push((format!("{missing}+{time}s"), newton_metres, torque));
        }
    }
    for sensor in &task.observe_sensors {
        let (name, unit, scale) = sensor_entry(*sensor);
        frame.push((name.to_owned(), unit, scale));
    }
    (0..task.observation_history)
        .rev()
        .flat_map(|age| {
            frame.iter().map(move |(name, unit, scale)| Entry {
                name: if age == 0 {
                    name.clone()
                } else {
                    format!("{name}@-{age}")
                },
                unit,
                scale: *scale,
            })
        })
        .collect()
}

/// Entries of one frame.
pub fn frame_size(task: &Task) -> usize {
    let identified = usize::from(task.observe_identified);
    let tip_error = if task.observe_tip_error {
        TIP_ERROR.len()
    } else {
        0
    };
    let still = STILL.len() * usize::from(task.observe_still_tip_error);
    let missing = usize::from(task.observe_payload_estimate);
    let estimated = (ESTIMATED.len() + 1) * missing;
    let preview = (PREVIEW.len() + missing) * task.preview_times.len();
    FIXED.len()
        + MOMENTUM.len()
        + identified
        + tip_error
        + still
        + estimated
        + preview
        + task.observe_sensors.len()
}

/// What is told of the payload: its mass (kg), length and width (m).
///
/// # Errors
/// A payload that cannot be.
pub(crate) fn told_payload(scenario: &Scenario, task: &Task) -> Result<[f64; 3], ConfigError> {
    let payload = match task.observe_payload {
        ObservePayload::Reported => scenario.reported()?,
        ObservePayload::True => scenario.true_payload()?,
        ObservePayload::Hidden => return Ok([0.0; 3]),
    };
    Ok([payload.mass, payload.length, payload.width])
}

/// Writes one frame for each of the lanes whose bits are set: `frame(lane)` is where that of a lane
/// goes. `payload` is what is told of the payloads.
#[inline(always)]
pub(crate) fn observe<'a, T: Number>(
    flight: &Flight<T>,
    task: &Task,
    payload: &[T; 3],
    lanes: u32,
    mut frame: impl FnMut(usize) -> &'a mut [f32],
) {
    let clock = flight.clock();
    let (reference, extension) = (&clock.reference, &clock.extension);
    let measurement = flight.measurement();
    let [angle, rate, ..] = flight.measured();
    let [slew_torque, root_torque, tip_torque] = flight.common.torques;
    let left = flight.slew_end_time() - clock.time;
    let values: [T; FIXED.len() + MOMENTUM.len()] = [
        measurement.slew_error,
        asinh(measurement.slew_error * (1.0 / FINE[0].1)),
        measurement.slew_error_rate,
        asinh(measurement.slew_error_rate * (1.0 / FINE[1].1)),
        angle,
        rate,
        measurement.link2_deflection,
        asinh(measurement.link2_deflection * (1.0 / FINE[2].1)),
        measurement.link2_deflection_rate,
        asinh(measurement.link2_deflection_rate * (1.0 / FINE[3].1)),
        reference.angle,
        reference.rate,
        reference.accel,
        extension.length,
        extension.rate,
        extension.accel,
        left.max(T::splat(0.0)),
        payload[0],
        payload[1],
        payload[2],
        slew_torque,
        root_torque,
        tip_torque,
        flight.common.root.momentum,
        flight.common.tip.momentum,
    ];
    let limit = T::splat(OBSERVATION_LIMIT);
    let mut scaled = values;
    for i in 0..scaled.len() {
        let (_, _, scale) = if i < FIXED.len() {
            FIXED[i]
        } else {
            MOMENTUM[i - FIXED.len()]
        };
        scaled[i] = (values[i] * (1.0 / scale)).limited(-limit, limit);
    }
    let identified = if task.observe_identified {
        flight.identified_mass_error() * (1.0 / IDENTIFIED.2)
    } else {
        T::splat(0.0)
    };
    let missing = task.observe_payload_estimate;
    let [error, mean_rate] = if missing {
        let [error, rate] = flight.estimate();
        [error, flight.reach() * (rate - reference.rate)]
    } else {
        [T::splat(0.0); 2]
    };
    let mean_rate_fine = if missing {
        asinh(mean_rate * (1.0 / MEAN_TIP_RATE_FINE))
    } else {
        T::splat(0.0)
    };
    let tip_error = if task.observe_tip_error {
        let error = flight.reach() * measurement.slew_error;
        [error, asinh(error * (1.0 / TIP_ERROR_FINE))]
    } else {
        [T::splat(0.0); 2]
    };
    let still = if task.observe_still_tip_error {
        let error = flight.still_tip_error();
        [error, asinh(error * (1.0 / STILL_TIP_ERROR_FINE))]
    } else {
        [T::splat(0.0); 2]
    };
    for lane in lanes_of(lanes) {
        let row = frame(lane);
        let (fixed, mut preview) = row.split_at_mut(scaled.len());
        for (entry, value) in fixed.iter_mut().zip(&scaled) {
            *entry = value.lane(lane) as f32;
        }
        if task.observe_identified {
            preview[0] = identified.lane(lane) as f32;
            preview = &mut preview[1..];
        }
        if task.observe_tip_error {
            let (entries, rest) = preview.split_at_mut(TIP_ERROR.len());
            for ((entry, value), (_, _, scale)) in entries.iter_mut().zip(tip_error).zip(TIP_ERROR)
            {
                let scaled = value.lane(lane) * (1.0 / scale);
                *entry = scaled.clamp(-OBSERVATION_LIMIT, OBSERVATION_LIMIT) as f32;
            }
            preview = rest;
        }
        let scaled = |value: f64, scale: f64| {
            (value * (1.0 / scale)).clamp(-OBSERVATION_LIMIT, OBSERVATION_LIMIT) as f32
        };
        if task.observe_still_tip_error {
            let (entries, rest) = preview.split_at_mut(STILL.len());
            for ((entry, value), (_, _, scale)) in entries.iter_mut().zip(still).zip(STILL) {
                *entry = scaled(value.lane(lane), scale);
            }
            preview = rest;
        }
        let (error, payload) = (error.lane(lane), flight.reported_share(lane));
        // what the payload takes beyond what the motor was told to give for it
        let lacking = |extension: &Extension<f64>, rate: f64, accel: f64| {
            scaled(
                error * payload.wanted_torque(extension, rate, accel),
                MISSING.2,
            )
        };
        if missing {
            let extension = extension.lane_of(lane);
            let (rate, accel) = (reference.rate.lane(lane), reference.accel.lane(lane));
            let (entries, rest) = preview.split_at_mut(ESTIMATED.len() + 1);
            let told = [error, mean_rate.lane(lane), mean_rate_fine.lane(lane)];
            for ((entry, value), (_, _, scale)) in entries.iter_mut().zip(told).zip(ESTIMATED) {
                *entry = scaled(value, scale);
            }
            entries[ESTIMATED.len()] = lacking(&extension, rate, accel);
            preview = rest;
        }
        let entries = PREVIEW.len() + usize::from(missing);
        let (preview, sensors) = preview.split_at_mut(entries * task.preview_times.len());
        for (entry, sensor) in sensors.iter_mut().zip(&task.observe_sensors) {
            let (_, _, scale) = sensor_entry(*sensor);
            *entry = scaled(read_by(flight, *sensor).lane(lane), scale);
        }
        let timeline = flight.timeline_of(lane);
        let now = clock.time.lane(lane);
        let mut index = flight.piece_of(lane);
        let mut last = 0.0;
        for (group, ahead) in preview.chunks_exact_mut(entries).zip(&task.preview_times) {
            if *ahead < last {
                index = flight.piece_of(lane);
            }
            last = *ahead;
            index = timeline.index_from(index, now + ahead);
            let piece = timeline.piece(index);
            let u = (now + ahead - piece.start).max(0.0);
            let ((accel, rate), extension) = (piece.motion(u), piece.extension(u));
            let then = [accel, extension.length];
            for ((entry, value), (_, _, scale)) in group.iter_mut().zip(then).zip(PREVIEW) {
                *entry = scaled(value, scale);
            }
            if let Some(entry) = group.get_mut(PREVIEW.len()) {
                *entry = lacking(&extension, rate, accel);
            }
        }
    }
}

/// What an instrument reads.
#[inline(always)]
fn read_by<T: Number>(flight: &Flight<T>, sensor: ObservedSensor) -> T {
    let [link1, link2, tip] = flight.measured_by_instruments();
    match sensor {
        ObservedSensor::Link1Gauge => link1,
        ObservedSensor::Link2Gauge => link2,
        ObservedSensor::TipAccelerometer => tip,
        ObservedSensor::TipGyro => flight.measured_tip_rate(),
    }
}

/// The frame of a flight now; `payload` is what is told of its payload.
pub(crate) fn frame_now(flight: &Flight, config: &EnvConfig, payload: &[f64; 3]) -> Vec<f32> {
    let task = &config.task;
    let mut frame = vec![0.0; frame_size(task)];
    let mut place = Some(frame.as_mut_slice());
    let place = |_| place.take().unwrap_or_default();
    if task.observe_still_tip_error {
        let mut modelled = flight.clone();
        modelled.model_for(&config.believed());
        observe(&modelled, task, payload, 1, place);
    } else {
        observe(flight, task, payload, 1, place);
    }
    frame
}

/// Number of entries of an observation.
pub fn observation_size(config: &EnvConfig) -> usize {
    frame_size(&config.task) * config.task.observation_history
}
