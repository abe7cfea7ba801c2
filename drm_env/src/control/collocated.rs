//! Collocated feedback with a gain schedule: each wheel is told what turns at its place, and takes energy out of it.
//!
//! ```text
//! T1 = -J (w^2 e + 2 d w F e')            at the shoulder
//! T2 = -g(m, a) F (theta' + slope' - theta'_ref)   at the tip
//! ```
//!
//! J is the moment of inertia of the whole arm with the reported payload at the present extension, so that the arm as
//! a whole has the same frequency w and damping ratio d at every length and mass. F is a low-pass filter of first
//! order: with it the feedback is positive real and stays so for every mode, known or not, as far as wheels and
//! sampling have no lag; beyond, the filter makes it small.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::low_pass::{LowPass, validate_filter};
use super::scheduled::{EXTENSION_SCALE, MASS_SCALE};
use super::{KnownInertia, LawMemory, Measurement, finite_gain};
use crate::error::ConfigError;
use crate::hardware::reaction_wheel::WheelTorques;
use crate::simd::Lane;

/// Feedback to the root wheel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CollocatedRoot {
    /// Angular frequency of the arm as a whole, rad/s.
    pub frequency: f64,
    /// Its damping ratio.
    pub damping: f64,
    /// Filter of the rate error; null is none.
    pub filter: Option<LowPass>,
}

impl Default for CollocatedRoot {
    fn default() -> Self {
        Self {
            frequency: 0.1,
            damping: 1.0,
            filter: Some(LowPass {
                cutoff: 2.0,
                order: 1,
            }),
        }
    }
}

/// Feedback to the tip wheel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CollocatedTip {
    /// On the rate at which the tip turns, N m s/rad: entry (i, j) multiplies (mass / 500 kg)^i
    /// (extension / 8 m)^j; beyond 500 kg the mass counts as 500 kg.
    pub turn_gain: [[f64; 2]; 2],
    /// Filter of it; null is none.
    pub filter: Option<LowPass>,
}

impl Default for CollocatedTip {
    fn default() -> Self {
        Self {
            turn_gain: [[300.0, 0.0], [0.0, 0.0]],
            filter: Some(LowPass {
                cutoff: 20.0,
                order: 1,
            }),
        }
    }
}

/// Collocated feedback; a wheel that is null stays off.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CollocatedLaw {
    /// Root wheel.
    pub root: Option<CollocatedRoot>,
    /// Tip wheel.
    pub tip: Option<CollocatedTip>,
}

impl Default for CollocatedLaw {
    fn default() -> Self {
        Self {
            root: Some(CollocatedRoot::default()),
            tip: Some(CollocatedTip::default()),
        }
    }
}

impl CollocatedLaw {
    pub(super) fn validate(&self) -> Result<(), ConfigError> {
        if let Some(root) = &self.root {
            finite_gain("root.frequency", root.frequency)?;
            finite_gain("root.damping", root.damping)?;
            validate_filter("root.filter", root.filter)?;
        }
        let Some(tip) = &self.tip else { return Ok(()) };
        for (i, row) in tip.turn_gain.iter().enumerate() {
            for (j, gain) in row.iter().enumerate() {
                finite_gain(&format!("tip.turn_gain[{i}][{j}]"), *gain)?;
            }
        }
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
        let off = T::splat(0.0);
        let started = memory.started;
        memory.started = T::splat(1.0);
        let [of_root, of_tip] = &mut memory.filters;
        let a = measured.extension;
        WheelTorques {
            root: match self.root {
                Some(k) => {
                    let rate = match k.filter {
                        Some(filter) => {
                            filter.pass(measured.slew_error_rate, of_root, started, period)
                        }
                        None => measured.slew_error_rate,
                    };
                    let accel = measured.slew_error * (k.frequency * k.frequency)
                        + rate * (2.0 * k.damping * k.frequency);
                    -(accel * a.polynomial(&known.whole))
                }
                None => off,
            },
            tip: match self.tip {
                Some(k) => {
                    let turn = measured.tip_turn_rate - measured.reference_rate;
                    let turn = match k.filter {
                        Some(filter) => filter.pass(turn, of_tip, started, period),
                        None => turn,
                    };
                    let mass = (known.mass * (1.0 / MASS_SCALE)).limited(off, T::splat(1.0));
                    let along = a * (1.0 / EXTENSION_SCALE);
                    let [[g00, g01], [g10, g11]] = k.turn_gain;
                    let gain = (along * g11 + g10) * mass + (along * g01 + g00);
                    -(turn * gain)
                }
                None => off,
            },
        }
    }
}
