//! Timed runs of the engine without Python around it.

use drm_env::benchmark;
use drm_env::error::ConfigError;
use drm_env::simd::Instructions;
use pyo3::prelude::*;

use crate::arrays::Count;
use crate::config::Config;
use crate::error::{Outcome, detached};
use crate::threads::within_processors;

/// Nanoseconds per Runge-Kutta step of 0.5 ms and environment of the thesis plant along the thesis
/// manoeuvre on the calling thread, over at least `steps` steps, and the lanes that were side by side:
/// 1 is the way of a single environment, 0 the widest that the processor has.
#[pyfunction]
pub(crate) fn kernel_benchmark(
    py: Python<'_>,
    lanes: usize,
    steps: usize,
) -> Outcome<(f64, usize)> {
    detached(py, || {
        let time = benchmark::kernel(lanes, steps)?;
        Ok::<_, ConfigError>((time.nanoseconds, time.lanes))
    })
}

/// Seconds that a single environment takes for `steps` control periods, resets included.
#[pyfunction]
pub(crate) fn env_benchmark(py: Python<'_>, config: &Config, steps: usize) -> Outcome<f64> {
    let config = config.held();
    detached(py, || benchmark::environment(config, steps))
}

/// Seconds that a batch takes for `steps` control periods, automatic resets included.
#[pyfunction]
#[pyo3(signature = (config, num_envs, steps, num_threads))]
pub(crate) fn batch_benchmark(
    py: Python<'_>,
    config: &Config,
    num_envs: Count,
    steps: usize,
    num_threads: Option<Count>,
) -> Outcome<f64> {
    let (config, num_threads) = (config.held(), within_processors(py, num_threads)?);
    detached(py, || {
        benchmark::batch(config, num_envs.0, steps, num_threads)
    })
}

/// The instructions that the engine has found on this processor, and the widths of its packs.
#[pyfunction]
pub(crate) fn instructions() -> (&'static str, Vec<usize>) {
    let found = Instructions::detect();
    (found.name(), found.widths().to_vec())
}
