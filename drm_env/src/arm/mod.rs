//! Parameters of the arm and its payload. `Default` is the thesis' arm.

pub mod mode_shape;
pub mod payload;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::positive;
use crate::error::ConfigError;

pub use payload::{Payload, PayloadInertia, PayloadProperties, TABLE_2_7, table_2_7_dimensions};

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

/// Deflection of a link's end per unit of its coordinate, alpha or beta, in the thesis' plant: its assumed
/// shape 3 u^2 - u^3 at u = 1.
pub const LINK_END_DEFLECTION: f64 = 2.0;

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
    ///
    /// # Errors
    /// A parameter that is not positive, with its path.
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
    ///
    /// # Errors
    /// An extension that the arm cannot have, by `path`.
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
