//! Dead time, noise, bias, resolution and bandwidth of what is measured.

use crate::check::{finite, non_negative, positive, zero_or_positive};
use crate::error::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Measured outputs: slew angle and rate, link-2 tip deflection and its rate, the rate at which the tip
/// turns, and what the instruments of [`Sensors::instruments`] read.
pub const OUTPUTS: usize = TIP_RATE + 1 + INSTRUMENTS;

/// Instruments that are there only where somebody wants them: they look at forces and accelerations.
pub const INSTRUMENTS: usize = 3;

/// Place among the measured outputs of the rate at which the tip turns.
pub(crate) const TIP_RATE: usize = 4;

/// Names of the measured outputs as signals, in order; rad, rad/s, m, m/s, rad/s, N m, N m and m/s^2.
pub const MEASURED_NAMES: [&str; OUTPUTS] = [
    "measured_slew_angle",
    "measured_slew_rate",
    "measured_link2_tip_deflection",
    "measured_link2_tip_deflection_rate",
    "measured_tip_turn_rate",
    "measured_link1_moment",
    "measured_link2_moment",
    "measured_tip_acceleration",
];

/// A strain gauge or an accelerometer; noise, bias and resolution are in the unit of what it reads.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Instrument {
    /// Whether it is there. One that is observed, or has an error or a bandwidth, is there anyway; one that
    /// is not reads nothing and costs nothing.
    pub fitted: bool,
    /// Standard deviation of its noise.
    pub noise: f64,
    /// Error that is the same through an episode.
    pub bias: f64,
    /// Quantum; 0 is none.
    pub resolution: f64,
    /// Angular frequency at which its first-order low pass cuts off (-3 dB), rad/s; null lets all pass.
    pub bandwidth: Option<f64>,
}

impl Instrument {
    /// Whether it is there.
    pub fn is_fitted(&self) -> bool {
        *self != Self::default()
    }

    fn validate(&self) -> Result<(), ConfigError> {
        non_negative("noise", self.noise)?;
        finite("bias", self.bias)?;
        zero_or_positive("resolution", self.resolution)?;
        validate_bandwidth("bandwidth", self.bandwidth)
    }
}

fn validate_bandwidth(path: &str, bandwidth: Option<f64>) -> Result<(), ConfigError> {
    bandwidth.map_or(Ok(()), |value| positive(path, value))
}

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
    /// Angular frequency at which the gyro's first-order low pass cuts off (-3 dB), rad/s; null lets all
    /// pass.
    pub tip_rate_bandwidth: Option<f64>,
    /// Error of the slew angle that is the same through an episode, rad.
    pub angle_bias: f64,
    /// The same of the slew rate, rad/s.
    pub rate_bias: f64,
    /// The same of the link-2 tip deflection, m.
    pub deflection_bias: f64,
    /// The same of the link-2 tip deflection rate, m/s.
    pub deflection_rate_bias: f64,
    /// The same of the gyro at the tip wheel, rad/s.
    pub tip_rate_bias: f64,
    /// Strain gauges at the root of link 1, which are calibrated to the bending moment there, N m.
    pub link1_gauge: Instrument,
    /// Strain gauges on link 2 where it leaves link 1, calibrated to the bending moment there, N m.
    pub link2_gauge: Instrument,
    /// Accelerometer where link 2 carries tip wheel and payload: the acceleration across the link there,
    /// m/s^2.
    pub tip_accelerometer: Instrument,
    /// Delay of all of them, s, rounded to whole samples.
    pub delay: f64,
}

impl Sensors {
    /// Strain gauges of link 1 and link 2, and the accelerometer.
    pub fn instruments(&self) -> [Instrument; INSTRUMENTS] {
        [self.link1_gauge, self.link2_gauge, self.tip_accelerometer]
    }

    /// Whether there is any of the instruments.
    pub fn has_instruments(&self) -> bool {
        self.instruments().iter().any(Instrument::is_fitted)
    }

    /// Fits instruments, in the same order.
    pub fn fit(&mut self, instruments: [bool; INSTRUMENTS]) {
        let [link1, link2, tip] = instruments;
        self.link1_gauge.fitted |= link1;
        self.link2_gauge.fitted |= link2;
        self.tip_accelerometer.fitted |= tip;
    }

    /// Standard deviations in the order of the measured outputs.
    pub fn noise(&self) -> [f64; OUTPUTS] {
        let [link1, link2, tip] = self.instruments().map(|instrument| instrument.noise);
        [
            self.angle_noise,
            self.rate_noise,
            self.deflection_noise,
            self.deflection_rate_noise,
            self.tip_rate_noise,
            link1,
            link2,
            tip,
        ]
    }

    /// Biases in the order of the measured outputs.
    pub fn bias(&self) -> [f64; OUTPUTS] {
        let [link1, link2, tip] = self.instruments().map(|instrument| instrument.bias);
        [
            self.angle_bias,
            self.rate_bias,
            self.deflection_bias,
            self.deflection_rate_bias,
            self.tip_rate_bias,
            link1,
            link2,
            tip,
        ]
    }

    /// Quanta in the order of the measured outputs.
    pub fn resolution(&self) -> [f64; OUTPUTS] {
        let [link1, link2, tip] = self.instruments().map(|instrument| instrument.resolution);
        [
            self.angle_resolution,
            self.rate_resolution,
            self.deflection_resolution,
            self.deflection_rate_resolution,
            self.tip_rate_resolution,
            link1,
            link2,
            tip,
        ]
    }

    /// Angular frequencies of the low passes, rad/s, in the order of the measured outputs.
    pub fn bandwidth(&self) -> [Option<f64>; OUTPUTS] {
        let [link1, link2, tip] = self.instruments().map(|instrument| instrument.bandwidth);
        let all = None;
        [
            all,
            all,
            all,
            all,
            self.tip_rate_bandwidth,
            link1,
            link2,
            tip,
        ]
    }

    /// Whether everything is measured as it is, at once, and nothing more than without them.
    pub(crate) fn are_exact(&self) -> bool {
        let zero = |values: [f64; OUTPUTS]| values.iter().all(|&value| value == 0.0);
        zero(self.noise())
            && zero(self.bias())
            && zero(self.resolution())
            && self.tip_rate_bandwidth.is_none()
            && !self.has_instruments()
    }

    pub(crate) fn validate(&self) -> Result<(), ConfigError> {
        let names = ["angle", "rate", "deflection", "deflection_rate", "tip_rate"];
        for (i, name) in names.iter().enumerate() {
            non_negative(&format!("{name}_noise"), self.noise()[i])?;
            zero_or_positive(&format!("{name}_resolution"), self.resolution()[i])?;
            finite(&format!("{name}_bias"), self.bias()[i])?;
        }
        validate_bandwidth("tip_rate_bandwidth", self.tip_rate_bandwidth)?;
        let names = ["link1_gauge", "link2_gauge", "tip_accelerometer"];
        for (name, instrument) in names.iter().zip(self.instruments()) {
            instrument.validate().map_err(|e| e.within(name))?;
        }
        non_negative("delay", self.delay)
    }
}
