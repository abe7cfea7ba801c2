//! Numbers and names of the engine that Python needs: it asks for them and keeps no copies.

use drm_env::arm::{PayloadInertia, TABLE_2_7};
use drm_env::config::distribution::KINDS;
use drm_env::config::parameter::Alternatives;
use drm_env::control::LAW_NAMES;
use drm_env::env::observation::FINE;
use pyo3::prelude::*;

/// x0 of the compressed entries `..._fine` of an observation, asinh(x / x0), by the name of x, in its
/// unit.
#[pyfunction]
pub(crate) fn fine_scales() -> Vec<(&'static str, f64)> {
    FINE.to_vec()
}

/// Mass (kg), length and width (m) of the payloads of Table 2-7, the lightest first, after none.
#[pyfunction]
pub(crate) fn table_2_7() -> Vec<(f64, f64, f64)> {
    TABLE_2_7.to_vec()
}

/// Names of the moments of inertia of a payload; a context holds the position.
#[pyfunction]
pub(crate) fn payload_inertias() -> Vec<&'static str> {
    PayloadInertia::NAMES.to_vec()
}

/// Names of the control laws.
#[pyfunction]
pub(crate) fn law_names() -> Vec<&'static str> {
    LAW_NAMES.to_vec()
}

/// Names of the distributions in their data form.
#[pyfunction]
pub(crate) fn distribution_names() -> Vec<&'static str> {
    KINDS.to_vec()
}
