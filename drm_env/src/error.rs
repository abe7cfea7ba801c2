//! Typed failures. Every variant carries the name of what is wrong and the offending value.

use crate::validity::{LARGEST_DEFLECTION, LARGEST_SLEW_ERROR};

/// A configuration, scenario or option that cannot be used. Nothing has changed when it is returned.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ConfigError {
    /// A value outside what the field allows.
    #[error("{path} {requirement}, got {value}")]
    Value {
        /// Dotted path of the field.
        path: String,
        /// What the field demands, as the rest of a sentence ("must be positive").
        requirement: String,
        /// The value as given.
        value: String,
    },
    /// Text or data that does not have the expected form.
    #[error("{path}: {message}")]
    Form {
        /// Dotted path of the field, or the name of the document.
        path: String,
        /// What is wrong with it.
        message: String,
    },
}

impl ConfigError {
    /// Builds a [`ConfigError::Value`].
    pub fn value(
        path: impl Into<String>,
        requirement: impl Into<String>,
        value: impl std::fmt::Display,
    ) -> Self {
        let text = value.to_string();
        // not hundreds of zeros
        let number = text.parse::<f64>().ok().filter(|_| text.len() > 24);
        Self::Value {
            path: path.into(),
            requirement: requirement.into(),
            value: number.map_or(text, |number| format!("{number:e}")),
        }
    }

    /// Builds a [`ConfigError::Form`].
    pub fn form(path: impl Into<String>, message: impl std::fmt::Display) -> Self {
        Self::Form {
            path: path.into(),
            message: message.to_string(),
        }
    }

    /// The same error one level further out: `prefix.path`.
    #[must_use]
    pub fn within(self, prefix: &str) -> Self {
        let join = |path: String| {
            if path.is_empty() {
                prefix.to_owned()
            } else {
                format!("{prefix}.{path}")
            }
        };
        match self {
            Self::Value {
                path,
                requirement,
                value,
            } => Self::Value {
                path: join(path),
                requirement,
                value,
            },
            Self::Form { path, message } => Self::Form {
                path: join(path),
                message,
            },
        }
    }
}

/// A call that cannot be carried out in the present state, or data of the wrong shape.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimulationError {
    /// `step` before the first `reset`, or after the end of an episode.
    #[error("{0}")]
    NotRunning(&'static str),
    /// An action with the wrong number of entries.
    #[error("action must have {expected} entries, got {got}")]
    ActionSize {
        /// Number of actuators.
        expected: usize,
        /// Entries given.
        got: usize,
    },
    /// A NaN or infinite action.
    #[error("action[{index}] must be finite, got {value}")]
    ActionNotFinite {
        /// Position within the flattened action.
        index: usize,
        /// The value as given.
        value: f64,
    },
    /// An array argument with the wrong length.
    #[error("{name} must have length {expected}, got {got}")]
    Length {
        /// Argument.
        name: &'static str,
        /// Expected length.
        expected: usize,
        /// Given length.
        got: usize,
    },
    /// A flight whose linear model was to be measured has left the limits of [`crate::validity`].
    #[error(
        "the flight diverged at t = {time} s: finite numbers, a tip deflection of at most {} of the reach \
         and a slew error of at most {LARGEST_SLEW_ERROR:.4} rad are what the equations describe",
        LARGEST_DEFLECTION
    )]
    Diverged {
        /// Simulated time, s.
        time: f64,
    },
    /// A network whose action in a rollout is NaN or infinite.
    #[error(
        "action[{entry}] of the policy in scenarios[{scenario}] at t = {time} s must be finite, got {value}"
    )]
    PolicyNotFinite {
        /// Position within the action.
        entry: usize,
        /// Which scenario of the list.
        scenario: usize,
        /// Simulated time, s.
        time: f64,
        /// The value.
        value: f64,
    },
    /// The caller's progress callback asked for the end.
    #[error("interrupted")]
    Interrupted,
}

/// A snapshot that cannot be restored. The environment is unchanged when it is returned.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SnapshotError {
    /// Not a snapshot of this library at all.
    #[error("not a drm_env snapshot")]
    Foreign,
    /// A snapshot whose checksum or content does not fit.
    #[error("damaged snapshot: {0}")]
    Damaged(String),
    /// Written by another version of the format.
    #[error("snapshot has format version {found}, this library reads version {expected}")]
    Version {
        /// Version in the data.
        found: u16,
        /// Version this library writes.
        expected: u16,
    },
    /// Taken from an environment with another configuration.
    #[error("the snapshot was taken from an environment with another configuration")]
    OtherConfiguration,
}

/// Any failure of the engine.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// See [`ConfigError`].
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// See [`SimulationError`].
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// See [`SnapshotError`].
    #[error(transparent)]
    Snapshot(#[from] SnapshotError),
}
