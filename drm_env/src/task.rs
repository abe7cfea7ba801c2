//! Observation, reward and limits: pure functions of what is flown. Not the integrator, not
//! randomness, not batches.

use crate::config::{EnvConfig, ObservePayload, Reward, Task};
use crate::flight::Flight;

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

/// Entries of each preview time: name, unit, scale.
const PREVIEW: [(&str, &str, f64); 2] = [
    ("reference_accel", "rad/s^2", 0.02),
    ("extension", "m", 8.0),
];

/// Where the compressed entries turn from linear to logarithmic: slew error (rad), its rate
/// (rad/s), deflection (m), its rate (m/s).
const FINE: [f64; 4] = [1e-5, 1e-5, 1e-5, 1e-4];

/// Names, units and scales of the whole observation in order; older frames first.
pub fn observation_layout(task: &Task) -> Vec<Entry> {
    let mut frame: Vec<(String, &'static str, f64)> = FIXED
        .iter()
        .chain(&MOMENTUM)
        .map(|&(name, unit, scale)| (name.to_owned(), unit, scale))
        .collect();
    for time in &task.preview_times {
        for (name, unit, scale) in PREVIEW {
            frame.push((format!("{name}+{time}s"), unit, scale));
        }
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
    FIXED.len() + MOMENTUM.len() + PREVIEW.len() * task.preview_times.len()
}

/// Writes one frame.
pub fn observe(flight: &Flight, task: &Task, frame: &mut Vec<f32>) {
    frame.clear();
    let mut push = |value: f64, scale: f64| {
        let scaled = (value / scale).clamp(-OBSERVATION_LIMIT, OBSERVATION_LIMIT);
        frame.push(scaled as f32);
    };
    let plan = flight.plan();
    let time = flight.time();
    let reference = flight.reference();
    let extension = flight.extension();
    let measurement = flight.measurement();
    let [angle, rate, ..] = flight.measured();
    let payload = match task.observe_payload {
        ObservePayload::Reported => Some(&plan.reported),
        ObservePayload::True => Some(&plan.payload),
        ObservePayload::Hidden => None,
    };
    let [slew_torque, root_torque, tip_torque] = flight.last_torques();
    let fine = |value: f64, index: usize| libm::asinh(value / FINE[index]);
    let values = [
        measurement.slew_error,
        fine(measurement.slew_error, 0),
        measurement.slew_error_rate,
        fine(measurement.slew_error_rate, 1),
        angle,
        rate,
        measurement.link2_deflection,
        fine(measurement.link2_deflection, 2),
        measurement.link2_deflection_rate,
        fine(measurement.link2_deflection_rate, 3),
        reference.angle,
        reference.rate,
        reference.accel,
        extension.length,
        extension.rate,
        extension.accel,
        (plan.slew_end_time - time).max(0.0),
        payload.map_or(0.0, |p| p.mass),
        payload.map_or(0.0, |p| p.length),
        payload.map_or(0.0, |p| p.width),
        slew_torque,
        root_torque,
        tip_torque,
    ];
    for (value, (_, _, scale)) in values.into_iter().zip(FIXED) {
        push(value, scale);
    }
    for (value, (_, _, scale)) in flight.wheel_momentum().into_iter().zip(MOMENTUM) {
        push(value, scale);
    }
    for ahead in &task.preview_times {
        let then = [
            plan.timeline.reference(time + ahead).accel,
            plan.timeline.extension(time + ahead).length,
        ];
        for (value, (_, _, scale)) in then.into_iter().zip(PREVIEW) {
            push(value, scale);
        }
    }
}

/// Names of the reward's terms, in the order of [`RewardSums::terms`].
pub const REWARD_NAMES: [&str; 3] = ["reward/tip_vibration", "reward/slew_error", "reward/effort"];

/// Sums over the samples of one action from which the reward's terms are made.
#[derive(Debug, Clone, Copy, Default)]
pub struct RewardSums {
    samples: f64,
    squared_vibration: f64,
    squared_slew: f64,
    effort: f64,
}

impl RewardSums {
    /// Takes the sample just flown.
    pub fn take(&mut self, flight: &Flight, reward: &Reward) {
        let scenario = &flight.plan().scenario;
        let (deflection, deflection_rate) = flight.tip_deflection();
        let reference = flight.reference();
        let reach = scenario.arm.link1.length + flight.extension().length;
        let error = flight.position()[0] - reference.angle;
        let error_rate = flight.velocity()[0] - reference.rate;
        let swing = deflection_rate * reward.vibration_time;
        let slide = reach * (error + error_rate * reward.slew_time);
        let [_, root, tip] = flight.last_torques();
        let (root, tip) = (
            root / scenario.root_wheel.torque_limit,
            tip / scenario.tip_wheel.torque_limit,
        );
        self.samples += 1.0;
        self.squared_vibration += deflection * deflection + swing * swing;
        self.squared_slew += slide * slide;
        self.effort += root * root + tip * tip;
    }

    /// The terms of a step of `duration` seconds, in the order of [`REWARD_NAMES`].
    pub fn terms(&self, reward: &Reward, duration: f64) -> [f64; 3] {
        if self.samples == 0.0 {
            return [0.0; 3];
        }
        let root = |sum: f64| libm::sqrt(sum / self.samples);
        [
            -reward.tip_vibration * duration * logarithmic(root(self.squared_vibration), reward),
            -reward.slew_error * duration * logarithmic(root(self.squared_slew), reward),
            -reward.effort * duration * self.effort / self.samples,
        ]
    }
}

/// An error (m) on the reward's logarithmic scale: 0 at none, 1 at one metre; errors beyond a
/// kilometre, and those that are not finite, count as one kilometre.
fn logarithmic(error: f64, reward: &Reward) -> f64 {
    let error = if error.is_finite() {
        error.min(1e3)
    } else {
        1e3
    };
    libm::log1p(error / reward.resolution) / libm::log1p(1.0 / reward.resolution)
}

/// What an episode that ends at a limit of the structure is charged for the `seconds` it leaves
/// unflown, on the terms of vibration and slew error: as if the limit were held to the end, so that
/// ending early never pays.
pub fn charge_for_rest(task: &Task, reach: f64, seconds: f64) -> [f64; 2] {
    let reward = &task.reward;
    let slide = reach * task.limits.slew_error;
    [
        -reward.tip_vibration * seconds * logarithmic(task.limits.tip_deflection, reward),
        -reward.slew_error * seconds * logarithmic(slide, reward),
    ]
}

/// Whether the flight is beyond a limit of the structure or no longer finite.
pub fn is_lost(flight: &Flight, task: &Task) -> bool {
    let error = flight.position()[0] - flight.reference().angle;
    !flight.is_finite()
        || error.abs() > task.limits.slew_error
        || flight.tip_deflection().0.abs() > task.limits.tip_deflection
}

/// Number of entries of an observation.
pub fn observation_size(config: &EnvConfig) -> usize {
    frame_size(&config.task) * config.task.observation_history
}
