//! Options of an environment: parts of a configuration and flat options, laid over a preset.

use serde_json::{Map, Value, json};

use crate::config::distribution::KINDS;
use crate::config::parameter::PARAMETERS;
use crate::error::ConfigError;

/// Options that are not scenario parameters: flat name, path, unit, what it is.
pub const OPTIONS: &[(&str, &str, &str, &str)] = &[
    ("plant", "scenario.plant", "-", "Equations of motion."),
    (
        "modes",
        "scenario.modes",
        "-",
        "Modes of link 1 and link 2 in the consistent plant.",
    ),
    (
        "spectral_radius",
        "scenario.dynamics.spectral_radius",
        "-",
        "Of the consistent plant's integrator at infinite frequency.",
    ),
    (
        "axial_load",
        "scenario.dynamics.axial_load",
        "-",
        "Stiffening by the axial load.",
    ),
    (
        "particle_following",
        "scenario.dynamics.particle_following",
        "-",
        "Follow the moving particles of link 2.",
    ),
    (
        "tip_torque",
        "scenario.dynamics.tip_torque",
        "-",
        "What the tip torque works on: slew_and_tip or tip_only.",
    ),
    (
        "integrator_step",
        "scenario.integrator_step",
        "s",
        "Longest integration step.",
    ),
    (
        "sample_period",
        "scenario.sample_period",
        "s",
        "Period of laws, sensors and metrics.",
    ),
    (
        "horizon",
        "scenario.horizon",
        "s",
        "Duration of an episode.",
    ),
    (
        "motor_constants",
        "scenario.slew_motor.constants",
        "-",
        "Motor model: fitted or printed constants.",
    ),
    (
        "slew_motor_torque_limit",
        "scenario.slew_motor.torque_limit",
        "N m",
        "Torque limit of the slew motor as an actuator.",
    ),
    (
        "motor_torque_limit",
        "scenario.slew_motor.open_loop_limit",
        "N m",
        "Torque limit of the slew motor in open loop.",
    ),
    (
        "motor_gear_ratio",
        "scenario.slew_motor.gear_ratio",
        "-",
        "Gear ratio between motor and shoulder.",
    ),
    (
        "motor_shaft_stiffness",
        "scenario.slew_motor.shaft_stiffness",
        "N m/rad",
        "Stiffness of the drive shaft; null is no shaft.",
    ),
    (
        "motor_shaft_damping",
        "scenario.slew_motor.shaft_damping",
        "N m s/rad",
        "Damping of the drive shaft.",
    ),
    (
        "slew_final_time",
        "scenario.slew.final_time",
        "s",
        "Duration of the slew, in the place of its acceleration.",
    ),
    (
        "slew_times",
        "scenario.slew.times",
        "s",
        "Times of a slew profile that is a table.",
    ),
    (
        "slew_accelerations",
        "scenario.slew.accelerations",
        "rad/s^2",
        "Accelerations at these times.",
    ),
    (
        "slew_shaper",
        "scenario.slew.shaper.kind",
        "-",
        "Input shaping of the slew: none, zv or zvd.",
    ),
    (
        "slew_shaper_frequency",
        "scenario.slew.shaper.frequency",
        "rad/s",
        "Frequency of the mode that it leaves at rest; null is the model's.",
    ),
    (
        "slew_shaper_damping_ratio",
        "scenario.slew.shaper.damping_ratio",
        "-",
        "Damping ratio of that mode as it is believed.",
    ),
    (
        "tip_rate_noise",
        "scenario.sensors.tip_rate_noise",
        "rad/s",
        "Noise of the gyro at the tip wheel.",
    ),
    (
        "tip_rate_resolution",
        "scenario.sensors.tip_rate_resolution",
        "rad/s",
        "Quantum of the gyro at the tip wheel.",
    ),
    (
        "tip_rate_bandwidth",
        "scenario.sensors.tip_rate_bandwidth",
        "rad/s",
        "Bandwidth of the gyro at the tip wheel; null is none.",
    ),
    (
        "link1_gauge_noise",
        "scenario.sensors.link1_gauge.noise",
        "N m",
        "Noise of the strain gauges of link 1.",
    ),
    (
        "link1_gauge_resolution",
        "scenario.sensors.link1_gauge.resolution",
        "N m",
        "Quantum of the strain gauges of link 1.",
    ),
    (
        "link1_gauge_bandwidth",
        "scenario.sensors.link1_gauge.bandwidth",
        "rad/s",
        "Bandwidth of the strain gauges of link 1; null is none.",
    ),
    (
        "link2_gauge_noise",
        "scenario.sensors.link2_gauge.noise",
        "N m",
        "Noise of the strain gauges of link 2.",
    ),
    (
        "link2_gauge_resolution",
        "scenario.sensors.link2_gauge.resolution",
        "N m",
        "Quantum of the strain gauges of link 2.",
    ),
    (
        "link2_gauge_bandwidth",
        "scenario.sensors.link2_gauge.bandwidth",
        "rad/s",
        "Bandwidth of the strain gauges of link 2; null is none.",
    ),
    (
        "tip_accelerometer_noise",
        "scenario.sensors.tip_accelerometer.noise",
        "m/s^2",
        "Noise of the accelerometer at the tip.",
    ),
    (
        "tip_accelerometer_resolution",
        "scenario.sensors.tip_accelerometer.resolution",
        "m/s^2",
        "Quantum of the accelerometer at the tip.",
    ),
    (
        "tip_accelerometer_bandwidth",
        "scenario.sensors.tip_accelerometer.bandwidth",
        "rad/s",
        "Bandwidth of the accelerometer at the tip; null is none.",
    ),
    (
        "control_period",
        "task.control_period",
        "s",
        "Time between two actions.",
    ),
    (
        "actuators",
        "task.actuators",
        "-",
        "What the action drives.",
    ),
    (
        "inner_law",
        "task.inner_law",
        "-",
        "Law below the agent's torques.",
    ),
    (
        "wheel_scale",
        "task.wheel_scale",
        "-",
        "Wheel torque at an action of 1, in multiples of the limit.",
    ),
    (
        "action_rate_limit",
        "task.action_rate_limit",
        "1/s",
        "Largest change of an action.",
    ),
    (
        "observe_payload",
        "task.observe_payload",
        "-",
        "reported, true or hidden.",
    ),
    (
        "observe_identified",
        "task.observe_identified",
        "-",
        "Whether the identified error of the reported mass is shown.",
    ),
    (
        "observe_tip_error",
        "task.observe_tip_error",
        "-",
        "Whether the slew error taken to the tip is shown.",
    ),
    (
        "observe_still_tip_error",
        "task.observe_still_tip_error",
        "-",
        "Whether the error of the tip without the vibration is shown.",
    ),
    (
        "observe_payload_estimate",
        "task.observe_payload_estimate",
        "-",
        "Whether a running estimate of the payload is shown, and what follows from it.",
    ),
    (
        "observe_sensors",
        "task.observe_sensors",
        "-",
        "Instruments whose readings are shown.",
    ),
    (
        "observation_history",
        "task.observation_history",
        "-",
        "Observations stacked.",
    ),
    (
        "preview_times",
        "task.preview_times",
        "s",
        "Times ahead that are shown.",
    ),
    (
        "reward",
        "task.reward",
        "-",
        "Weights and scales of the reward.",
    ),
    (
        "limits",
        "task.limits",
        "-",
        "Limits that terminate an episode.",
    ),
    ("scenario", "scenario", "-", "Parts of the scenario."),
    (
        "randomize",
        "randomize",
        "-",
        "Distributions by flat parameter name.",
    ),
    ("task", "task", "-", "Parts of the task."),
];

/// Puts the parts given over a document. A law and a distribution are replaced whole.
pub(crate) fn overlay(document: &mut Value, parts: Map<String, Value>) {
    let Value::Object(fields) = document else {
        *document = Value::Object(parts);
        return;
    };
    for (name, part) in parts {
        match (fields.get_mut(&name), part) {
            (Some(inner @ Value::Object(_)), Value::Object(part))
                if name != "inner_law" && !inner.is_null() && !is_distribution(inner) =>
            {
                overlay(inner, part);
            }
            (_, part) => {
                fields.insert(name, part);
            }
        }
    }
}

/// A scenario parameter that is given is no longer drawn, unless its distribution is given too.
pub(crate) fn release_fixed(document: &mut Value, parts: &Map<String, Value>) {
    let Some(scenario) = parts.get("scenario") else {
        return;
    };
    for parameter in PARAMETERS {
        let pointer = format!("/{}", parameter.path.replace('.', "/"));
        let drawn = parts.get("randomize").and_then(|r| r.get(parameter.name));
        if scenario.pointer(&pointer).is_some() && drawn.is_none() {
            set_drawn(document, parameter.name, Value::Null);
        }
    }
}

pub(crate) fn is_distribution(value: &Value) -> bool {
    value.as_object().is_some_and(|fields| {
        fields.len() == 1 && KINDS.iter().any(|name| fields.contains_key(*name))
    })
}

/// Sets a flat option: a scenario parameter (fixed by a number, name or null, else drawn), or one of
/// [`OPTIONS`].
///
/// # Errors
/// An unknown name.
pub(crate) fn apply_option(
    document: &mut Value,
    name: &str,
    value: Value,
) -> Result<(), ConfigError> {
    if let Some(parameter) = PARAMETERS.iter().find(|p| p.name == name) {
        let fixed = value.is_number() || value.is_string() || value.is_null();
        // the two ways to state the reported mass exclude each other
        let rival = match name {
            "reported_payload_mass" => Some(("mass_error", json!(0.0))),
            "mass_error" => Some(("reported_payload_mass", Value::Null)),
            _ => None,
        };
        if let Some((rival, off)) = rival.filter(|_| !value.is_null()) {
            set_drawn(document, rival, Value::Null);
            let path = PARAMETERS.iter().find(|p| p.name == rival).map(|p| p.path);
            place(
                document,
                &format!("scenario.{}", path.unwrap_or(rival)),
                off,
            );
        }
        if fixed {
            set_drawn(document, name, Value::Null);
            place(document, &format!("scenario.{}", parameter.path), value);
        } else {
            set_drawn(document, name, value);
        }
        return Ok(());
    }
    if let Some((_, path, _, _)) = OPTIONS.iter().find(|(option, ..)| *option == name) {
        if name == "scenario" {
            release_fixed(
                document,
                &Map::from_iter([(name.to_owned(), value.clone())]),
            );
        }
        place(document, path, value);
        return Ok(());
    }
    let known: Vec<&str> = PARAMETERS
        .iter()
        .map(|p| p.name)
        .chain(OPTIONS.iter().map(|(option, ..)| *option))
        .collect();
    let close = known
        .iter()
        .filter(|candidate| candidate.contains(name) || name.contains(**candidate))
        .copied()
        .collect::<Vec<_>>();
    let hint = if close.is_empty() { known } else { close };
    Err(ConfigError::form(
        name,
        format!(
            "is not an option (given {value}); known are {}",
            hint.join(", ")
        ),
    ))
}

/// Sets how a parameter is drawn. What is no table there is left, to be refused where it is read.
fn set_drawn(document: &mut Value, name: &str, drawn: Value) {
    if let Some(Value::Object(table)) = document.get_mut("randomize") {
        table.insert(name.to_owned(), drawn);
    }
}

/// Puts a value at a dotted path; objects are overlaid.
fn place(document: &mut Value, path: &str, value: Value) {
    let pointer = format!("/{}", path.replace('.', "/"));
    let Some(slot) = document.pointer_mut(&pointer) else {
        return;
    };
    match value {
        Value::Object(parts) if slot.is_object() && path != "task.inner_law" => {
            overlay(slot, parts);
        }
        value => *slot = value,
    }
}
