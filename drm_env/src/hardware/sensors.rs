//! Dead time, noise, bias and resolution of what is measured.

use crate::check::{non_negative, zero_or_positive};
use crate::error::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Measured outputs: slew angle and rate, link-2 tip deflection and its rate, and the rate at which the
/// tip turns.
pub const OUTPUTS: usize = 5;

/// Errors of the measured outputs; all zero is exact.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Sensors {
    /// Standard deviation of the slew angle's noise, rad.
    pub angle_noise: f64,
    /// Standard deviation of the slew rate's noise, rad/s.
    pub rate_noise: f64,
    /// Standard deviation of the link-2 tip deflection's noise, m.
    pub deflection_noise: f64,
    /// Standard deviation of the link-2 tip deflection rate's noise, m/s.
    pub deflection_rate_noise: f64,
    /// Quantum of the slew angle, rad; 0 is none.
    pub angle_resolution: f64,
    /// Quantum of the slew rate, rad/s; 0 is none.
    pub rate_resolution: f64,
    /// Quantum of the link-2 tip deflection, m; 0 is none.
    pub deflection_resolution: f64,
    /// Quantum of the link-2 tip deflection rate, m/s; 0 is none.
    pub deflection_rate_resolution: f64,
    /// Standard deviation of the noise of the gyro at the tip wheel, rad/s.
    pub tip_rate_noise: f64,
    /// Quantum of it, rad/s; 0 is none.
    pub tip_rate_resolution: f64,
    /// Delay of all of them, s, rounded to whole samples.
    pub delay: f64,
}

impl Sensors {
    /// Standard deviations in the order of the measured outputs.
    pub fn noise(&self) -> [f64; OUTPUTS] {
        [
            self.angle_noise,
            self.rate_noise,
            self.deflection_noise,
            self.deflection_rate_noise,
            self.tip_rate_noise,
        ]
    }

    /// Quanta in the order of the measured outputs.
    pub fn resolution(&self) -> [f64; OUTPUTS] {
        [
            self.angle_resolution,
            self.rate_resolution,
            self.deflection_resolution,
            self.deflection_rate_resolution,
            self.tip_rate_resolution,
        ]
    }

    pub(crate) fn validate(&self) -> Result<(), ConfigError> {
        let names = ["angle", "rate", "deflection", "deflection_rate", "tip_rate"];
        for (i, name) in names.iter().enumerate() {
            non_negative(&format!("{name}_noise"), self.noise()[i])?;
            zero_or_positive(&format!("{name}_resolution"), self.resolution()[i])?;
        }
        non_negative("delay", self.delay)
    }
}
