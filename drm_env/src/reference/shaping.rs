//! Input shaping (Smith 1957; Singer and Seering 1990) as it is asked for: which shaper, for which mode, and the shares
//! of its parts. [`super::shaped`] makes the shaped profile.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::{non_negative, positive};
use crate::error::ConfigError;

/// Kind of shaper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ShaperKind {
    /// The profile as it is.
    #[default]
    None,
    /// Two parts: no vibration of the mode that is modelled.
    Zv,
    /// Three parts: nearly none either where the frequency is somewhat wrong.
    Zvd,
}

/// Input shaping of the slew.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Shaper {
    /// Kind.
    pub kind: ShaperKind,
    /// Angular frequency of the mode, rad/s; null is that of the lowest mode of the arm as it is modelled, at the
    /// length of the time and with the reported payload.
    pub frequency: Option<f64>,
    /// Damping ratio of the mode as the shaper believes it.
    pub damping_ratio: f64,
    /// Bending stiffness of the links as the shaper believes it, N m^2.
    pub bending_stiffness: [f64; 2],
}

impl Default for Shaper {
    fn default() -> Self {
        let arm = crate::arm::Arm::default();
        Self {
            kind: ShaperKind::None,
            frequency: None,
            damping_ratio: 0.0,
            bending_stiffness: [arm.link1.bending_stiffness, arm.link2.bending_stiffness],
        }
    }
}

/// Parts of a shaper, in turn.
#[derive(Debug, Clone, PartialEq)]
pub struct Parts {
    /// Share of each; their sum is 1.
    pub shares: Vec<f64>,
}

impl Shaper {
    pub(super) fn validate(&self) -> Result<(), ConfigError> {
        if let Some(frequency) = self.frequency {
            positive("frequency", frequency)?;
        }
        non_negative("damping_ratio", self.damping_ratio)?;
        if self.damping_ratio >= 1.0 {
            let requirement = "must be below 1: a mode that is damped more does not vibrate";
            return Err(ConfigError::value(
                "damping_ratio",
                requirement,
                self.damping_ratio,
            ));
        }
        for (i, stiffness) in self.bending_stiffness.iter().enumerate() {
            positive(&format!("bending_stiffness[{i}]"), *stiffness)?;
        }
        Ok(())
    }

    /// Damped angular frequency over the undamped one.
    pub fn damped(&self) -> f64 {
        libm::sqrt(1.0 - self.damping_ratio * self.damping_ratio)
    }

    /// The shares of the parts: 1 : K, or 1 : 2 K : K^2, with K what is left of an amplitude after half a period.
    pub fn parts(&self) -> Parts {
        let left = libm::exp(-std::f64::consts::PI * self.damping_ratio / self.damped());
        let whole = 1.0 + left;
        let shares = match self.kind {
            ShaperKind::None => vec![1.0],
            ShaperKind::Zv => vec![1.0 / whole, left / whole],
            ShaperKind::Zvd => {
                let square = whole * whole;
                vec![1.0 / square, 2.0 * left / square, left * left / square]
            }
        };
        Parts { shares }
    }
}
