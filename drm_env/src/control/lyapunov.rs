//! The Lyapunov-based law (thesis sections 3.5 and 4.6.2):
//! T1 = -J1 e' - J2 e - J3 (Jtt e'' + Jtb beta''), T2 = -Jtb beta'. Accelerations are backward
//! differences of the sampled rates, zero at the first sample.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::low_pass::{LowPass, validate_filter};
use super::{KnownInertia, LawMemory, Measurement, finite_gain};
use crate::error::ConfigError;
use crate::hardware::reaction_wheel::WheelTorques;
use crate::simd::Lane;

/// Gains of the root wheel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LyapunovRoot {
    /// J1, on the slew rate error, N m s/rad.
    pub rate_gain: f64,
    /// J2, on the slew error, N m/rad.
    pub angle_gain: f64,
    /// J3, on the inertial moment of link 2 and payload.
    pub acceleration_gain: f64,
    /// Filter of the slew rate error; null is none.
    pub filter: Option<LowPass>,
}

impl Default for LyapunovRoot {
    fn default() -> Self {
        Self {
            rate_gain: 3.0e4,
            angle_gain: 3.0e3,
            acceleration_gain: 2.0e-4,
            filter: None,
        }
    }
}

/// Gain of the tip wheel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LyapunovTip {
    /// On Jtb beta', 1/s.
    pub gain: f64,
    /// Filter of the deflection's rate (thesis section 3.4.2); null is none.
    pub filter: Option<LowPass>,
}

impl Default for LyapunovTip {
    fn default() -> Self {
        Self {
            gain: 1.0,
            filter: None,
        }
    }
}

/// The Lyapunov-based law; a wheel that is null stays off.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LyapunovLaw {
    /// Root wheel.
    pub root: Option<LyapunovRoot>,
    /// Tip wheel.
    pub tip: Option<LyapunovTip>,
}

impl Default for LyapunovLaw {
    fn default() -> Self {
        Self {
            root: Some(LyapunovRoot::default()),
            tip: Some(LyapunovTip::default()),
        }
    }
}

impl LyapunovLaw {
    pub(super) fn validate(&self) -> Result<(), ConfigError> {
        if let Some(root) = &self.root {
            finite_gain("root.rate_gain", root.rate_gain)?;
            finite_gain("root.angle_gain", root.angle_gain)?;
            finite_gain("root.acceleration_gain", root.acceleration_gain)?;
            validate_filter("root.filter", root.filter)?;
        }
        let Some(tip) = &self.tip else { return Ok(()) };
        finite_gain("tip.gain", tip.gain)?;
        validate_filter("tip.filter", tip.filter)
    }

    #[inline(always)]
    pub(super) fn torques<T: Lane>(
        &self,
        measured: &Measurement<T>,
        known: &KnownInertia<T>,
        memory: &mut LawMemory<T>,
        period: f64,
    ) -> WheelTorques<T> {
        let mut measured = *measured;
        let [of_root, of_tip] = &mut memory.filters;
        let started = memory.started;
        if let Some(filter) = self.root.and_then(|root| root.filter) {
            measured.slew_error_rate =
                filter.pass(measured.slew_error_rate, of_root, started, period);
        }
        if let Some(filter) = self.tip.and_then(|tip| tip.filter) {
            measured.link2_deflection_rate =
                filter.pass(measured.link2_deflection_rate, of_tip, started, period);
        }
        let off = T::splat(0.0);
        let a = measured.extension;
        let r = known.l1 + a;
        let l1_cubed = known.l1 * known.l1 * known.l1;
        let jtt = known.rho2 * (r * r * r - l1_cubed) * (1.0 / 3.0)
            + known.inertia_attachment
            + known.mass * r * r;
        let jtb = known.rho2 * a * (known.l1 * 0.75 + a * 0.55)
            + known.inertia_attachment * 3.0 / a
            + known.mass * r * 2.0;
        let per_sample = memory.started * (1.0 / period);
        let accel = (measured.slew_error_rate - memory.slew_error_rate) * per_sample;
        let beta_rate = measured.link2_deflection_rate * 0.5;
        let beta_accel =
            (measured.link2_deflection_rate - memory.link2_deflection_rate) * (per_sample * 0.5);
        *memory = LawMemory {
            slew_error_rate: measured.slew_error_rate,
            link2_deflection_rate: measured.link2_deflection_rate,
            started: T::splat(1.0),
            servo: memory.servo,
            filters: memory.filters,
        };
        WheelTorques {
            root: match self.root {
                Some(k) => {
                    -(measured.slew_error_rate * k.rate_gain)
                        - measured.slew_error * k.angle_gain
                        - (jtt * accel + jtb * beta_accel) * k.acceleration_gain
                }
                None => off,
            },
            tip: match self.tip {
                Some(k) => -(jtb * beta_rate * k.gain),
                None => off,
            },
        }
    }
}
