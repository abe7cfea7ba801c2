//! Parameters of the arm and its payload. `Default` is the thesis' arm.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::error::ConfigError;

/// One uniform flexible link.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Link {
    /// Length, m.
    pub length: f64,
    /// Bending stiffness EI, N m^2.
    pub bending_stiffness: f64,
    /// Mass per length, kg/m.
    pub mass_per_length: f64,
}

/// The two links (thesis section 2.1).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Arm {
    /// The slewing link, pinned at the shoulder: 7 m, 100 kg, 2.5e6 N m^2.
    pub link1: Link,
    /// The link that slides out of the first: 8 m, 75 kg, 3.0e6 N m^2.
    pub link2: Link,
}

impl Default for Arm {
    fn default() -> Self {
        Self {
            link1: Link {
                length: 7.0,
                bending_stiffness: 2.5e6,
                mass_per_length: 100.0 / 7.0,
            },
            link2: Link {
                length: 8.0,
                bending_stiffness: 3.0e6,
                mass_per_length: 75.0 / 8.0,
            },
        }
    }
}

impl Arm {
    /// Shortest length of link 2 outside link 1, m: at it link 2 reaches back to the shoulder.
    pub fn shortest_extension(&self) -> f64 {
        (self.link2.length - self.link1.length).max(0.0)
    }

    /// Refuses lengths, stiffnesses and densities that are not positive.
    pub fn validate(&self) -> Result<(), ConfigError> {
        for (name, link) in [("link1", &self.link1), ("link2", &self.link2)] {
            positive(&format!("{name}.length"), link.length)?;
            positive(&format!("{name}.bending_stiffness"), link.bending_stiffness)?;
            positive(&format!("{name}.mass_per_length"), link.mass_per_length)?;
        }
        Ok(())
    }

    /// Refuses an extension outside the arm: link 2 must stay inside link 1 at one end and hold on
    /// to it at the other.
    pub fn validate_extension(&self, path: &str, extension: f64) -> Result<(), ConfigError> {
        let (low, high) = (self.shortest_extension(), self.link2.length);
        if extension.is_finite() && extension > 0.0 && (low..=high).contains(&extension) {
            return Ok(());
        }
        Err(ConfigError::value(
            path,
            format!("must be within the arm's {low} m to {high} m"),
            extension,
        ))
    }
}

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
}

impl Default for Payload {
    /// Payload 1 of Table 2-7.
    fn default() -> Self {
        Self {
            mass: 200.0,
            length: None,
            width: None,
            inertia: PayloadInertia::Full,
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
}

impl PayloadProperties {
    /// Completes a payload; `path` names it in errors.
    ///
    /// # Errors
    /// A mass or dimension that is negative or not finite.
    pub fn resolve(payload: &Payload) -> Result<Self, ConfigError> {
        non_negative("mass", payload.mass)?;
        let (table_length, table_width) = table_2_7_dimensions(payload.mass);
        let length = payload.length.unwrap_or(table_length);
        let width = payload.width.unwrap_or(table_width);
        non_negative("length", length)?;
        non_negative("width", width)?;
        Ok(Self::new(payload.mass, length, width, payload.inertia))
    }

    /// From mass (kg), length and width (m).
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
        }
    }
}

/// Largest magnitude of a number that a user gives, and the smallest of one that is divided by. No arm
/// comes near either; squares, cubes and quotients of such numbers stay finite.
const LARGEST: f64 = 1e20;
const SMALLEST: f64 = 1e-20;

/// Refuses a value that is not positive and finite, or of a magnitude that nothing can be computed with.
pub(crate) fn positive(path: &str, value: f64) -> Result<(), ConfigError> {
    let requirement = if !(value.is_finite() && value > 0.0) {
        "must be positive and finite".to_owned()
    } else if !(SMALLEST..=LARGEST).contains(&value) {
        format!("must be within {SMALLEST:e} to {LARGEST:e}")
    } else {
        return Ok(());
    };
    Err(ConfigError::value(path, requirement, value))
}

/// Refuses a value that is negative, not finite or too large to compute with.
pub(crate) fn non_negative(path: &str, value: f64) -> Result<(), ConfigError> {
    let requirement = if !(value.is_finite() && value >= 0.0) {
        "must be finite and not negative".to_owned()
    } else if value > LARGEST {
        format!("must be at most {LARGEST:e}")
    } else {
        return Ok(());
    };
    Err(ConfigError::value(path, requirement, value))
}

/// Refuses a value that is neither 0 nor what [`positive`] takes.
pub(crate) fn zero_or_positive(path: &str, value: f64) -> Result<(), ConfigError> {
    non_negative(path, value)?;
    if value == 0.0 {
        return Ok(());
    }
    positive(path, value)
}

/// Refuses a value that is not finite or too large to compute with.
pub(crate) fn finite(path: &str, value: f64) -> Result<(), ConfigError> {
    let requirement = if !value.is_finite() {
        "must be finite".to_owned()
    } else if value.abs() > LARGEST {
        format!("must be at most {LARGEST:e} in magnitude")
    } else {
        return Ok(());
    };
    Err(ConfigError::value(path, requirement, value))
}
