//! Python bindings of the engine. They translate types and errors; they decide and compute nothing.

mod analysis;
mod arrays;
mod batch;
mod benchmark;
mod config;
mod env;
mod error;
mod kept;
mod rollout;
mod threads;

use pyo3::prelude::*;

/// Loads what is needed of Python. The package calls it when it is imported: when something is first used,
/// a signal may come between, and there is nobody there to raise what its handler raises.
#[pyfunction]
fn load(py: Python<'_>) -> PyResult<()> {
    arrays::load(py)?;
    error::load(py)
}

/// The engine of drm_env: everything that computes.
#[pymodule]
mod _engine {
    #[pymodule_export]
    #[allow(non_upper_case_globals)]
    const __version__: &str = env!("CARGO_PKG_VERSION");

    #[pymodule_export]
    use super::analysis::{
        Law, Model, check_memory, measurement_names, sample_scenarios, signal_names, simulate,
        transitions,
    };
    #[pymodule_export]
    use super::batch::{Batch, panic_after_parts};
    #[pymodule_export]
    use super::benchmark::{batch_benchmark, env_benchmark, instructions, kernel_benchmark};
    #[pymodule_export]
    use super::config::{
        context_names, default_config_json, metric_names, observation_layout, option_names_json,
        resolve_config, reward_names, schema_json,
    };
    #[pymodule_export]
    use super::env::Env;
    #[pymodule_export]
    use super::load;
    #[pymodule_export]
    use super::rollout::{Network, rollout};
}
