//! The linear law: T1 = -K1 e' - K2 e at the root, T2 = -K3 beta' at the tip
//! (thesis section 4.6.1; K1 multiplies the rate, which alone reproduces the published overshoots).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Measurement, finite_gain};
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
}

impl Default for LinearRoot {
    fn default() -> Self {
        Self {
            rate_gain: 8.0e4,
            angle_gain: 8.0e3,
        }
    }
}

/// Gain of the tip wheel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LinearTip {
    /// On beta' (half the rate of link 2's tip deflection), N s.
    pub rate_gain: f64,
}

impl Default for LinearTip {
    fn default() -> Self {
        Self { rate_gain: 500.0 }
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
        }
        self.tip
            .map_or(Ok(()), |tip| finite_gain("tip.rate_gain", tip.rate_gain))
    }

    #[inline(always)]
    pub(super) fn torques<T: Lane>(&self, measured: &Measurement<T>) -> WheelTorques<T> {
        let off = T::splat(0.0);
        WheelTorques {
            root: match self.root {
                Some(k) => {
                    -(measured.slew_error_rate * k.rate_gain) - measured.slew_error * k.angle_gain
                }
                None => off,
            },
            tip: match self.tip {
                Some(k) => -(measured.link2_deflection_rate * (0.5 * k.rate_gain)),
                None => off,
            },
        }
    }
}
