//! The payload at the tip.

use crate::check::{finite, non_negative};
use crate::error::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How the payload's moment of inertia is formed from its dimensions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PayloadInertia {
    /// A rectangle: m (l^2 + w^2) / 12 about its centre, as the thesis' text prescribes.
    #[default]
    Full,
    /// A rod: m l^2 / 12 about its centre, as the thesis' published numbers were made.
    Slender,
}

/// A payload as a user states it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Payload {
    /// Mass, kg; 0 means no payload.
    pub mass: f64,
    /// Length along the arm, m; null takes it from Table 2-7 by interpolation over the mass.
    pub length: Option<f64>,
    /// Width across the arm, m; null takes it from Table 2-7 by interpolation over the mass.
    pub width: Option<f64>,
    /// Which moment of inertia the dimensions give.
    pub inertia: PayloadInertia,
    /// Distance of the centre of mass from the arm's axis, m: positive where a positive slew goes. Of the
    /// consistent plant; the thesis' payloads are on the axis.
    pub offset: f64,
}

impl Default for Payload {
    /// Payload 1 of Table 2-7.
    fn default() -> Self {
        Self {
            mass: 200.0,
            length: None,
            width: None,
            inertia: PayloadInertia::Full,
            offset: 0.0,
        }
    }
}

/// Table 2-7 of the thesis: mass (kg), length (m), width (m); preceded by "no payload".
pub const TABLE_2_7: [(f64, f64, f64); 5] = [
    (0.0, 0.0, 0.0),
    (50.0, 0.10, 0.10),
    (200.0, 1.0, 0.5),
    (350.0, 1.5, 0.75),
    (500.0, 2.0, 1.0),
];

/// Length and width (m) of a payload of this mass (kg): linear between the rows of
/// [`TABLE_2_7`], and those of the heaviest row beyond it.
pub fn table_2_7_dimensions(mass: f64) -> (f64, f64) {
    for rows in TABLE_2_7.windows(2) {
        let ((m0, l0, w0), (m1, l1, w1)) = (rows[0], rows[1]);
        if mass <= m1 {
            let f = ((mass - m0) / (m1 - m0)).max(0.0);
            return (l0 + f * (l1 - l0), w0 + f * (w1 - w0));
        }
    }
    let (_, length, width) = TABLE_2_7[TABLE_2_7.len() - 1];
    (length, width)
}

/// A payload with every dimension known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PayloadProperties {
    /// Mass Mp, kg.
    pub mass: f64,
    /// Length along the arm Lp, m.
    pub length: f64,
    /// Width across the arm Sp, m.
    pub width: f64,
    /// Moment of inertia Ip about the payload's centre, kg m^2.
    pub inertia_centre: f64,
    /// Moment of inertia J = Ip + Mp Lp^2 / 4 about the attachment point, kg m^2.
    pub inertia_attachment: f64,
    /// Distance of the centre of mass from the arm's axis, m.
    pub offset: f64,
}

impl PayloadProperties {
    /// Completes a payload; `path` names it in errors.
    ///
    /// # Errors
    /// A mass or dimension that is negative or not finite, an offset that is not finite.
    pub fn resolve(payload: &Payload) -> Result<Self, ConfigError> {
        non_negative("mass", payload.mass)?;
        let (table_length, table_width) = table_2_7_dimensions(payload.mass);
        let length = payload.length.unwrap_or(table_length);
        let width = payload.width.unwrap_or(table_width);
        non_negative("length", length)?;
        non_negative("width", width)?;
        finite("offset", payload.offset)?;
        Ok(Self {
            offset: payload.offset,
            ..Self::new(payload.mass, length, width, payload.inertia)
        })
    }

    /// Moment of inertia about the point of the axis beside the centre of mass, kg m^2.
    pub fn inertia_on_axis(&self) -> f64 {
        (self.mass * self.offset).mul_add(self.offset, self.inertia_centre)
    }

    /// From mass (kg), length and width (m); the centre of mass on the arm's axis.
    pub fn new(mass: f64, length: f64, width: f64, inertia: PayloadInertia) -> Self {
        let across = match inertia {
            PayloadInertia::Full => width,
            PayloadInertia::Slender => 0.0,
        };
        let inertia_centre = mass * (length * length + across * across) / 12.0;
        Self {
            mass,
            length,
            width,
            inertia_centre,
            inertia_attachment: inertia_centre + mass * length * length / 4.0,
            offset: 0.0,
        }
    }
}
