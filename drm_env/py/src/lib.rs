//! Python bindings of the engine. They translate types and errors; they decide and compute nothing.

mod analysis;
mod arrays;
mod asked;
mod batch;
mod benchmark;
mod config;
mod constants;
mod env;
mod error;
mod kept;
mod pictures;
mod rollout;
mod threads;

use pyo3::prelude::*;

/// Loads what is needed of Python. The package calls it when it is imported: when something is first used,
/// a signal may come between, and there is nobody there to raise what its handler raises.
#[pyfunction]
fn load(py: Python<'_>) -> PyResult<()> {
    arrays::load(py)?;
    error::load(py)?;
    error::guarded(drm_env::simd::Instructions::wanted)?;
    Ok(())
}

/// The engine of drm_env: everything that computes.
#[pymodule]
mod _engine {
    #[pymodule_export]
    #[allow(non_upper_case_globals)]
    const __version__: &str = env!("CARGO_PKG_VERSION");

    /// Columns of the coordinates of a batch.
    #[pymodule_export]
    const COORDINATES: usize = drm_env::batch::COORDINATES;
    /// Sampling period that the thesis' gains were chosen for, s.
    #[pymodule_export]
    const LAW_PERIOD: f64 = drm_env::control::LAW_PERIOD;
    /// Numbers that a law remembers.
    #[pymodule_export]
    const LAW_MEMORY: usize = drm_env::control::MEMORY_SIZE;
    /// Deflection of a link's end per unit of its coordinate.
    #[pymodule_export]
    const LINK_END_DEFLECTION: f64 = drm_env::arm::LINK_END_DEFLECTION;
    /// Slew rate below which a payload is not identified, rad/s.
    #[pymodule_export]
    const SLOWEST_IDENTIFICATION: f64 = drm_env::simulation::identification::SLOWEST_IDENTIFICATION;
    /// Largest mass error that is taken for one.
    #[pymodule_export]
    const LARGEST_IDENTIFIED_ERROR: f64 =
        drm_env::simulation::identification::LARGEST_IDENTIFIED_ERROR;
    /// Mass that the scheduled law divides by, kg.
    #[pymodule_export]
    const SCHEDULED_MASS_SCALE: f64 = drm_env::control::scheduled::MASS_SCALE;
    /// Extension that the scheduled law divides by, m.
    #[pymodule_export]
    const SCHEDULED_EXTENSION_SCALE: f64 = drm_env::control::scheduled::EXTENSION_SCALE;

    #[pymodule_export]
    use super::analysis::{
        Law, Model, check_memory, load_names, measured_names, measurement_names, prescribed,
        sample_scenarios, signal_names, simulate, transitions,
    };
    #[pymodule_export]
    use super::asked::rollout_asked;
    #[pymodule_export]
    use super::batch::{Batch, panic_after_parts};
    #[pymodule_export]
    use super::benchmark::{batch_benchmark, env_benchmark, instructions, kernel_benchmark};
    #[pymodule_export]
    use super::config::{
        Config, context_names, metric_names, option_names_json, reward_names, schema_json,
        task_names,
    };
    #[pymodule_export]
    use super::constants::{
        distribution_names, fine_scales, law_names, payload_inertias, table_2_7,
    };
    #[pymodule_export]
    use super::env::Env;
    #[pymodule_export]
    use super::load;
    #[pymodule_export]
    use super::pictures::{Film, Painter, film_signals, palette};
    #[pymodule_export]
    use super::rollout::{Network, rollout};
}
