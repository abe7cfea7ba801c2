//! The linear law: T1 = -K1 e' - K2 e at the root, T2 = -K3 beta' at the tip
//! (thesis section 4.6.1; K1 multiplies the rate, which alone reproduces the published overshoots).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::low_pass::{LowPass, validate_filter};
use super::{LawMemory, Measurement, finite_gain};
use crate::error::ConfigError;
use crate::hardware::reaction_wheel::WheelTorques;
use crate::simd::Lane;

/// Gains of the root wheel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LinearRoot {
    /// On the slew rate error, N m s/rad.
    pub rate_gain: f64,
    /// On the slew error, N m/rad.
    pub angle_gain: f64,
    /// Filter of the slew rate error; null is none.
    pub filter: Option<LowPass>,
}

impl Default for LinearRoot {
    fn default() -> Self {
        Self {
            rate_gain: 8.0e4,
            angle_gain: 8.0e3,
            filter: None,
        }
    }
}

/// Gains of the tip wheel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LinearTip {
    /// On beta' (half the rate of link 2's tip deflection), N s.
    pub rate_gain: f64,
    /// On the rate at which the tip turns, less that of the reference, N m s/rad: what the wheel works on, so
    /// that it takes energy out of every mode.
    pub turn_gain: f64,
    /// Filter of what is fed back (thesis section 3.4.2); null is none.
    pub filter: Option<LowPass>,
}

impl Default for LinearTip {
    fn default() -> Self {
        Self {
            rate_gain: 500.0,
            turn_gain: 0.0,
            filter: None,
        }
    }
}

/// The linear law; a wheel that is null stays off.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LinearLaw {
    /// Root wheel.
    pub root: Option<LinearRoot>,
    /// Tip wheel.
    pub tip: Option<LinearTip>,
}

impl Default for LinearLaw {
    fn default() -> Self {
        Self {
            root: Some(LinearRoot::default()),
            tip: Some(LinearTip::default()),
        }
    }
}

impl LinearLaw {
    pub(super) fn validate(&self) -> Result<(), ConfigError> {
        if let Some(root) = &self.root {
            finite_gain("root.rate_gain", root.rate_gain)?;
            finite_gain("root.angle_gain", root.angle_gain)?;
            validate_filter("root.filter", root.filter)?;
        }
        let Some(tip) = &self.tip else { return Ok(()) };
        finite_gain("tip.rate_gain", tip.rate_gain)?;
        finite_gain("tip.turn_gain", tip.turn_gain)?;
        validate_filter("tip.filter", tip.filter)
    }

    #[inline(always)]
    pub(super) fn torques<T: Lane>(
        &self,
        measured: &Measurement<T>,
        memory: &mut LawMemory<T>,
        period: f64,
    ) -> WheelTorques<T> {
        let off = T::splat(0.0);
        let started = memory.started;
        let [of_root, of_tip] = &mut memory.filters;
        let root = match self.root {
            Some(k) => {
                let rate = match k.filter {
                    Some(filter) => {
                        memory.started = T::splat(1.0);
                        filter.pass(measured.slew_error_rate, of_root, started, period)
                    }
                    None => measured.slew_error_rate,
                };
                -(rate * k.rate_gain) - measured.slew_error * k.angle_gain
            }
            None => off,
        };
        let tip = match self.tip {
            Some(k) => {
                let mut torque = -(measured.link2_deflection_rate * (0.5 * k.rate_gain));
                if k.turn_gain != 0.0 {
                    let turn = measured.tip_turn_rate - measured.reference_rate;
                    torque -= turn * k.turn_gain;
                }
                match k.filter {
                    Some(filter) => {
                        memory.started = T::splat(1.0);
                        filter.pass(torque, of_tip, started, period)
                    }
                    None => torque,
                }
            }
            None => off,
        };
        WheelTorques { root, tip }
    }
}
