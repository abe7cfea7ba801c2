//! Which Python exception each failure becomes, and the wall that no panic passes.

use std::panic::{AssertUnwindSafe, catch_unwind};

use drm_env::error::{ConfigError, Error, SimulationError, SnapshotError};
use drm_env::interruption::{self, Interrupted};
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

impl From<Interrupted> for Failure {
    fn from(_: Interrupted) -> Self {
        SimulationError::Interrupted.into()
    }
}

/// [`guarded`], with the interpreter released. Every 50 ms Python may attend to signals, if this is its
/// main thread: what a handler raises ends the work early and is raised here.
pub(crate) fn detached<T: Send, E: Into<Failure>>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T, E> + Send,
) -> Outcome<T> {
    let (result, raised) = py.detach(|| {
        let mut raised = None;
        let mut go_on = || match Python::try_attach(|py| py.check_signals()) {
            Some(Err(error)) => {
                raised = Some(error);
                false
            }
            Some(Ok(())) | None => true,
        };
        let result = guarded(|| {
            interruption::watch(&mut go_on, || work().map_err(Into::into))
                .map_err(Failure::from)
                .flatten()
        });
        (result, raised)
    });
    match raised {
        Some(error) => Err(Failure(error)),
        None => result,
    }
}

/// An engine that cannot be used now, or no more.
pub(crate) fn unusable(text: &'static str) -> Failure {
    Failure(exceptions::SimulationError::new_err(text))
}

/// Loads every exception that is raised from here: when one is raised a signal may come between.
///
/// # Errors
/// What the import raises.
pub(crate) fn load(py: Python<'_>) -> PyResult<()> {
    py.import("drm_env.errors")?;
    let _ = (
        py.get_type::<DrmError>(),
        py.get_type::<exceptions::ConfigError>(),
        py.get_type::<exceptions::SimulationError>(),
        py.get_type::<exceptions::ActionError>(),
        py.get_type::<exceptions::ResetNeededError>(),
        py.get_type::<exceptions::SnapshotError>(),
    );
    Ok(())
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
