//! Refusals of numbers that a parameter cannot have.

use crate::error::ConfigError;

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

/// Refuses a value that is neither 0 nor what [`positive`] takes.
pub(crate) fn zero_or_positive(path: &str, value: f64) -> Result<(), ConfigError> {
    non_negative(path, value)?;
    if value == 0.0 {
        return Ok(());
    }
    positive(path, value)
}
