//! Which Python exception each failure becomes, and the wall that no panic passes.

use std::panic::{AssertUnwindSafe, catch_unwind};

use drm_env::error::{ConfigError, Error, SimulationError, SnapshotError};
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::import_exception;
use pyo3::prelude::*;

mod exceptions {
    // Written in Python, so that type checkers see them: pyo3 leaves exception types made in Rust
    // out of the stub.
    pyo3::import_exception!(drm_env.errors, ConfigError);
    pyo3::import_exception!(drm_env.errors, SimulationError);
    pyo3::import_exception!(drm_env.errors, ActionError);
    pyo3::import_exception!(drm_env.errors, ResetNeededError);
    pyo3::import_exception!(drm_env.errors, SnapshotError);
}
import_exception!(drm_env.errors, DrmError);

/// A failure on its way to Python (a type of our own, for both the engine's error and `PyErr` are
/// foreign here).
#[derive(Debug)]
pub(crate) struct Failure(PyErr);

/// What every function of the bindings returns.
pub(crate) type Outcome<T> = Result<T, Failure>;

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let text = error.to_string();
        Self(match error {
            Error::Config(_) => exceptions::ConfigError::new_err(text),
            Error::Snapshot(_) => exceptions::SnapshotError::new_err(text),
            Error::Simulation(error) => match error {
                SimulationError::NotRunning(_) => exceptions::ResetNeededError::new_err(text),
                SimulationError::ActionSize { .. } | SimulationError::ActionNotFinite { .. } => {
                    exceptions::ActionError::new_err(text)
                }
                SimulationError::Interrupted => PyKeyboardInterrupt::new_err(text),
                _ => exceptions::SimulationError::new_err(text),
            },
        })
    }
}

macro_rules! through_engine_error {
    ($($error:ty),+) => {$(
        impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Error::from(error).into()
            }
        }
    )+};
}
through_engine_error!(ConfigError, SimulationError, SnapshotError);

impl From<PyErr> for Failure {
    fn from(error: PyErr) -> Self {
        Self(error)
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        failure.0
    }
}

/// Runs `work`; a panic inside becomes a `DrmError`.
pub(crate) fn guarded<T, E: Into<Failure>>(work: impl FnOnce() -> Result<T, E>) -> Outcome<T> {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(result) => result.map_err(Into::into),
        Err(panic) => {
            let text = panic
                .downcast_ref::<String>()
                .map(String::as_str)
                .or_else(|| panic.downcast_ref::<&str>().copied())
                .unwrap_or("no message");
            Err(Failure(DrmError::new_err(format!(
                "internal error, please report it: {text}"
            ))))
        }
    }
}

/// [`guarded`], with the interpreter released.
pub(crate) fn detached<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T, Error> + Send,
) -> Outcome<T> {
    py.detach(|| guarded(work))
}

/// An internal error of an earlier call left the engine half-way through something.
pub(crate) fn poisoned() -> Failure {
    Failure(exceptions::SimulationError::new_err(
        "unusable after an internal error; make a new one",
    ))
}

/// Refuses an array of another shape than the one needed.
pub(crate) fn check_shape(name: &str, got: &[usize], want: &[usize]) -> Outcome<()> {
    if got == want {
        return Ok(());
    }
    Err(Failure(exceptions::SimulationError::new_err(format!(
        "{name} must have shape {want:?}, got {got:?}"
    ))))
}
