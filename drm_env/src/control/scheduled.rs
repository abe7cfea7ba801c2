//! Output feedback whose gains are scheduled over extension and reported mass:
//! T = -(k1 e + k2 e' + k3 y2 + k4 y2') for each wheel, where each gain is a polynomial. A linear-quadratic
//! regulator designed along the deployment takes this form; the thesis has none. Reported masses beyond
//! 500 kg count as 500 kg.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{KnownInertia, Measurement, finite_gain};
use crate::error::ConfigError;
use crate::hardware::reaction_wheel::WheelTorques;
use crate::simd::Lane;

/// Reported mass by which the mass of a gain's polynomial is divided, kg (Payload 3 of Table 2-7).
pub const MASS_SCALE: f64 = 500.0;
/// Extension by which the extension of a gain's polynomial is divided, m (link 2).
pub const EXTENSION_SCALE: f64 = 8.0;

/// Coefficients of a gain: entry (i, j) multiplies (mass / 500 kg)^i (extension / 8 m)^j.
pub type Polynomial = [[f64; 4]; 3];

/// Gains of one wheel.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ScheduledWheel {
    /// On the slew error, N m/rad: entry (i, j) multiplies (mass / 500 kg)^i (extension / 8 m)^j.
    pub angle_gain: Polynomial,
    /// On the slew rate error, N m s/rad, likewise.
    pub rate_gain: Polynomial,
    /// On link 2's tip deflection, N, likewise.
    pub deflection_gain: Polynomial,
    /// On its rate, N s, likewise.
    pub deflection_rate_gain: Polynomial,
}

/// Output feedback scheduled over extension and reported mass; a wheel that is null stays off.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ScheduledLaw {
    /// Root wheel.
    pub root: Option<ScheduledWheel>,
    /// Tip wheel.
    pub tip: Option<ScheduledWheel>,
}

impl ScheduledLaw {
    pub(super) fn validate(&self) -> Result<(), ConfigError> {
        for (wheel, gains) in [("root", &self.root), ("tip", &self.tip)] {
            let Some(gains) = gains else { continue };
            for (name, polynomial) in [
                ("angle_gain", &gains.angle_gain),
                ("rate_gain", &gains.rate_gain),
                ("deflection_gain", &gains.deflection_gain),
                ("deflection_rate_gain", &gains.deflection_rate_gain),
            ] {
                for value in polynomial.iter().flatten() {
                    finite_gain(&format!("{wheel}.{name}"), *value)?;
                }
            }
        }
        Ok(())
    }

    #[inline(always)]
    pub(super) fn torques<T: Lane>(
        &self,
        measured: &Measurement<T>,
        known: &KnownInertia<T>,
    ) -> WheelTorques<T> {
        // a polynomial says nothing beyond the masses that it was fitted to
        let mass = (known.mass * (1.0 / MASS_SCALE)).limited(T::splat(0.0), T::splat(1.0));
        let extension = measured.extension * (1.0 / EXTENSION_SCALE);
        let off = T::splat(0.0);
        WheelTorques {
            root: match &self.root {
                Some(gains) => gains.torque(measured, mass, extension),
                None => off,
            },
            tip: match &self.tip {
                Some(gains) => gains.torque(measured, mass, extension),
                None => off,
            },
        }
    }
}

impl ScheduledWheel {
    #[inline(always)]
    fn torque<T: Lane>(&self, measured: &Measurement<T>, mass: T, extension: T) -> T {
        -(measured.slew_error * value(&self.angle_gain, mass, extension))
            - measured.slew_error_rate * value(&self.rate_gain, mass, extension)
            - measured.link2_deflection * value(&self.deflection_gain, mass, extension)
            - measured.link2_deflection_rate * value(&self.deflection_rate_gain, mass, extension)
    }
}

/// A polynomial at scaled mass and extension.
#[inline(always)]
fn value<T: Lane>(polynomial: &Polynomial, mass: T, extension: T) -> T {
    let mut sum = T::splat(0.0);
    for i in (0..polynomial.len()).rev() {
        let row = &polynomial[i];
        let mut along = T::splat(row[3]);
        for j in (0..3).rev() {
            along = along * extension + row[j];
        }
        sum = sum * mass + along;
    }
    sum
}
