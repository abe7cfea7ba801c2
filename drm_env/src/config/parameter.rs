//! Every scenario parameter under one flat name: what can be drawn for each episode, overridden at
//! reset and read from the context.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::arm::PayloadInertia;
use crate::config::distribution::{Distribution, Setting};
use crate::config::scenario::Scenario;
use crate::error::ConfigError;
use crate::reference::deployment::DeploymentMode;
use crate::reference::slew::SlewProfile;

/// One entry of [`PARAMETERS`].
pub struct Parameter {
    /// Flat name: `payload_mass`.
    pub name: &'static str,
    /// Path within the scenario: `payload.mass`.
    pub path: &'static str,
    /// SI unit, `-` where there is none.
    pub unit: &'static str,
    /// What it is.
    pub description: &'static str,
    assign: fn(&mut Scenario, &Setting) -> Result<(), String>,
    number: fn(&Scenario) -> Option<f64>,
    setting: fn(&Scenario) -> Option<Setting>,
}

impl Parameter {
    /// What the parameter is set to; none if a null stands in its place.
    pub fn setting(&self, scenario: &Scenario) -> Option<Setting> {
        (self.setting)(scenario)
    }

    /// Sets the parameter in a scenario.
    ///
    /// # Errors
    /// A name where a number is due, or an unknown alternative.
    pub fn set(&self, scenario: &mut Scenario, setting: &Setting) -> Result<(), ConfigError> {
        (self.assign)(scenario, setting)
            .map_err(|requirement| ConfigError::value(self.path, requirement, setting))?;
        // the reported mass is given either outright or by its error
        match self.name {
            "reported_payload_mass" => scenario.mass_error = 0.0,
            "mass_error" => scenario.reported_payload.mass = None,
            _ => {}
        }
        Ok(())
    }

    /// Value in a valid scenario as a number: what a null stands for, the position of an
    /// alternative in its list, infinity for a limit that is not set.
    pub fn value(&self, scenario: &Scenario) -> f64 {
        let truth = scenario.true_payload();
        let reported = scenario.reported();
        match (self.name, truth, reported) {
            ("payload_length", Ok(truth), _) => truth.length,
            ("payload_width", Ok(truth), _) => truth.width,
            ("reported_payload_mass", _, Ok(reported)) => reported.mass,
            ("reported_payload_length", _, Ok(reported)) => reported.length,
            ("reported_payload_width", _, Ok(reported)) => reported.width,
            ("mass_error", Ok(truth), Ok(reported)) if truth.mass > 0.0 => {
                if scenario.reported_payload.mass.is_some() {
                    reported.mass / truth.mass - 1.0
                } else {
                    scenario.mass_error
                }
            }
            _ => (self.number)(scenario).unwrap_or(f64::INFINITY),
        }
    }
}

/// A field that a [`Setting`] can be assigned to.
trait Slot {
    fn assign(&mut self, setting: &Setting) -> Result<(), String>;
    fn number(&self) -> Option<f64>;
    fn setting(&self) -> Option<Setting>;
}

impl Slot for f64 {
    fn assign(&mut self, setting: &Setting) -> Result<(), String> {
        match setting {
            Setting::Number(value) => {
                *self = *value;
                Ok(())
            }
            Setting::Name(_) => Err("must be a number".into()),
        }
    }

    fn number(&self) -> Option<f64> {
        Some(*self)
    }

    fn setting(&self) -> Option<Setting> {
        Some(Setting::Number(*self))
    }
}

impl Slot for Option<f64> {
    fn assign(&mut self, setting: &Setting) -> Result<(), String> {
        let mut value = 0.0;
        value.assign(setting)?;
        *self = Some(value);
        Ok(())
    }

    fn number(&self) -> Option<f64> {
        *self
    }

    fn setting(&self) -> Option<Setting> {
        self.map(Setting::Number)
    }
}

/// What a name chooses between.
pub trait Alternatives {
    /// The names; a context holds the position of the chosen one.
    const NAMES: &'static [&'static str];
}

macro_rules! alternatives {
    ($type:ty: $($variant:ident = $name:literal),+) => {
        impl Alternatives for $type {
            const NAMES: &'static [&'static str] = &[$($name),+];
        }

        impl Slot for $type {
            fn assign(&mut self, setting: &Setting) -> Result<(), String> {
                *self = match setting {
                    $(Setting::Name(name) if name == $name => Self::$variant,)+
                    _ => return Err(format!("must be one of {}", Self::NAMES.join(", "))),
                };
                Ok(())
            }

            fn number(&self) -> Option<f64> {
                [$(Self::$variant),+]
                    .iter()
                    .position(|variant| variant == self)
                    .map(|position| position as f64)
            }

            fn setting(&self) -> Option<Setting> {
                let name = match self {
                    $(Self::$variant => $name),+
                };
                Some(Setting::Name(name.into()))
            }
        }
    };
}

alternatives!(PayloadInertia: Full = "full", Slender = "slender");
alternatives!(SlewProfile: MinTime = "min_time", MinEnergy = "min_energy", Table = "table");
alternatives!(DeploymentMode:
    Coincident = "coincident", ForceLimited = "force_limited", None = "none");

macro_rules! scenario_parameters {
    ($($name:ident = $($field:ident).+, $unit:literal, $description:literal;)+) => {
        /// Every scenario parameter, in the order in which an episode draws them.
        pub static PARAMETERS: &[Parameter] = &[$(Parameter {
            name: stringify!($name),
            path: concat_path!($($field).+),
            unit: $unit,
            description: $description,
            assign: |scenario, setting| scenario.$($field).+.assign(setting),
            number: |scenario| scenario.$($field).+.number(),
            setting: |scenario| scenario.$($field).+.setting(),
        }),+];

        /// What is drawn for each episode, by flat parameter name; null keeps the scenario's value.
        #[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        pub struct Randomize {
            $(
                #[doc = $description]
                pub $name: Option<Distribution>,
            )+
        }

        impl Randomize {
            /// Distributions in the order of [`PARAMETERS`].
            pub fn distributions(&self) -> [Option<&Distribution>; COUNT] {
                [$(self.$name.as_ref()),+]
            }

            /// Places of the distributions in the order of [`PARAMETERS`].
            pub(crate) fn places(&mut self) -> [&mut Option<Distribution>; COUNT] {
                [$(&mut self.$name),+]
            }
        }

        /// Number of scenario parameters.
        pub const COUNT: usize = [$(stringify!($name)),+].len();
    };
}

macro_rules! concat_path {
    ($first:ident) => { stringify!($first) };
    ($first:ident . $($rest:ident).+) => {
        concat!(stringify!($first), ".", concat_path!($($rest).+))
    };
}

scenario_parameters! {
    payload_mass = payload.mass, "kg", "True payload mass; 0 is no payload.";
    payload_length = payload.length, "m", "True payload length along the arm.";
    payload_width = payload.width, "m", "True payload width across the arm.";
    payload_inertia = payload.inertia, "-", "Payload inertia: full or slender.";
    payload_offset = payload.offset, "m", "Distance of the payload's centre of mass from the axis.";
    mass_error = mass_error, "-", "Relative error of the reported payload mass.";
    reported_payload_mass = reported_payload.mass, "kg", "Reported payload mass.";
    reported_payload_length = reported_payload.length, "m", "Reported payload length.";
    reported_payload_width = reported_payload.width, "m", "Reported payload width.";
    slew_angle = slew.angle, "rad", "Angle to slew through.";
    slew_max_accel = slew.max_accel, "rad/s^2", "Largest slew acceleration.";
    slew_profile = slew.profile, "-", "Slew profile: min_time, min_energy or table.";
    slew_smoothing = slew.smoothing, "-", "Smoothing fraction of the slew profile.";
    deployment_start = deployment.start, "m", "Extension of link 2 at the beginning.";
    deployment_end = deployment.end, "m", "Extension of link 2 at the end.";
    deployment_mode = deployment.mode, "-", "Deployment: coincident, force_limited or none.";
    deployment_force = deployment.force, "N", "Force of the force-limited deployment.";
    initial_slew_angle = initial.slew_angle, "rad", "Slew angle at the beginning.";
    initial_slew_rate = initial.slew_rate, "rad/s", "Slew rate at the beginning.";
    initial_alpha = initial.alpha, "m", "Modal coordinate of link 1 at the beginning.";
    initial_alpha_rate = initial.alpha_rate, "m/s", "Its rate at the beginning.";
    initial_beta = initial.beta, "m", "Modal coordinate of link 2 at the beginning.";
    initial_beta_rate = initial.beta_rate, "m/s", "Its rate at the beginning.";
    root_torque_limit = root_wheel.torque_limit, "N m", "Torque limit of the root wheel.";
    root_momentum_limit = root_wheel.momentum_limit, "N m s", "Momentum limit of the root wheel.";
    root_lag = root_wheel.lag, "s", "First-order lag of the root wheel.";
    root_dead_time = root_wheel.dead_time, "s", "Dead time of the root wheel.";
    tip_torque_limit = tip_wheel.torque_limit, "N m", "Torque limit of the tip wheel.";
    tip_momentum_limit = tip_wheel.momentum_limit, "N m s", "Momentum limit of the tip wheel.";
    tip_lag = tip_wheel.lag, "s", "First-order lag of the tip wheel.";
    tip_dead_time = tip_wheel.dead_time, "s", "Dead time of the tip wheel.";
    angle_noise = sensors.angle_noise, "rad", "Noise of the measured slew angle.";
    rate_noise = sensors.rate_noise, "rad/s", "Noise of the measured slew rate.";
    deflection_noise = sensors.deflection_noise, "m", "Noise of the measured deflection.";
    deflection_rate_noise = sensors.deflection_rate_noise, "m/s",
        "Noise of the measured deflection rate.";
    angle_resolution = sensors.angle_resolution, "rad", "Quantum of the measured slew angle.";
    rate_resolution = sensors.rate_resolution, "rad/s", "Quantum of the measured slew rate.";
    deflection_resolution = sensors.deflection_resolution, "m",
        "Quantum of the measured deflection.";
    deflection_rate_resolution = sensors.deflection_rate_resolution, "m/s",
        "Quantum of the measured deflection rate.";
    sensor_delay = sensors.delay, "s", "Delay of the measured outputs.";
    structural_damping = dynamics.structural_damping, "s", "Kelvin-Voigt time constant.";
    damping_ratio = dynamics.damping_ratio, "-", "Damping ratio of every mode of the consistent plant.";
    link1_length = arm.link1.length, "m", "Length of link 1.";
    link1_bending_stiffness = arm.link1.bending_stiffness, "N m^2", "Stiffness of link 1.";
    link1_mass_per_length = arm.link1.mass_per_length, "kg/m", "Mass per length of link 1.";
    link2_length = arm.link2.length, "m", "Length of link 2.";
    link2_bending_stiffness = arm.link2.bending_stiffness, "N m^2", "Stiffness of link 2.";
    link2_mass_per_length = arm.link2.mass_per_length, "kg/m", "Mass per length of link 2.";
    angle_bias = sensors.angle_bias, "rad", "Bias of the measured slew angle.";
    rate_bias = sensors.rate_bias, "rad/s", "Bias of the measured slew rate.";
    deflection_bias = sensors.deflection_bias, "m", "Bias of the measured deflection.";
    deflection_rate_bias = sensors.deflection_rate_bias, "m/s",
        "Bias of the measured deflection rate.";
    tip_rate_bias = sensors.tip_rate_bias, "rad/s", "Bias of the gyro at the tip wheel.";
    link1_gauge_bias = sensors.link1_gauge.bias, "N m", "Bias of the strain gauges of link 1.";
    link2_gauge_bias = sensors.link2_gauge.bias, "N m", "Bias of the strain gauges of link 2.";
    tip_accelerometer_bias = sensors.tip_accelerometer.bias, "m/s^2",
        "Bias of the accelerometer at the tip.";
}

/// Position of a flat name in [`PARAMETERS`].
pub fn position(name: &str) -> Option<usize> {
    PARAMETERS.iter().position(|p| p.name == name)
}

/// What single parameters are set to or drawn from, by position in [`PARAMETERS`].
pub type Overrides = Vec<(usize, Distribution)>;

/// Reads a flat JSON object of settings and distributions (`{"payload_mass": 320.0}`).
///
/// # Errors
/// A name that is no scenario parameter, or a value that it cannot be set to or drawn from.
pub fn overrides(text: &str) -> Result<Overrides, ConfigError> {
    let fields: serde_json::Map<String, serde_json::Value> =
        serde_json::from_str(text).map_err(|e| ConfigError::form("options", e))?;
    let mut probe = Scenario::default();
    fields
        .into_iter()
        .map(|(name, value)| {
            let index = position(&name)
                .ok_or_else(|| ConfigError::form(name.clone(), "is not a scenario parameter"))?;
            let drawn = Distribution::try_from(value).map_err(|e| ConfigError::form(&name, e))?;
            drawn.validate().map_err(|e| e.within(&name))?;
            for setting in drawn.extremes() {
                PARAMETERS[index].set(&mut probe, &setting)?;
            }
            Ok((index, drawn))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_name_the_fields_they_set() {
        for parameter in PARAMETERS {
            let json = serde_json::to_value(Scenario::default()).unwrap();
            let pointer = format!("/{}", parameter.path.replace('.', "/"));
            assert!(json.pointer(&pointer).is_some(), "{}", parameter.path);
        }
    }

    #[test]
    fn alternatives_match_their_serialised_names() {
        for (name, alternative) in [
            ("payload_inertia", "slender"),
            ("slew_profile", "min_energy"),
            ("deployment_mode", "force_limited"),
        ] {
            let parameter = &PARAMETERS[position(name).unwrap()];
            let mut scenario = Scenario::default();
            let setting = Setting::Name(alternative.into());
            parameter.set(&mut scenario, &setting).unwrap();
            let json = serde_json::to_value(scenario).unwrap();
            let pointer = format!("/{}", parameter.path.replace('.', "/"));
            assert_eq!(json.pointer(&pointer).unwrap(), alternative);
        }
    }
}
