//! How many threads a call may have.

use std::ffi::CString;

use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;

use crate::arrays::Count;

/// What is asked for, with a warning where it is more than there are processors, which is then the number:
/// more threads only wait for each other, and thousands stop a machine.
pub(crate) fn within_processors(py: Python<'_>, asked: Option<Count>) -> PyResult<Option<usize>> {
    let Some(Count(asked)) = asked else {
        return Ok(None);
    };
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    if asked > processors {
        let text =
            format!("num_threads={asked} is more than the processors: {processors} are used");
        let category = py.get_type::<PyUserWarning>();
        PyErr::warn(py, &category, &CString::new(text)?, 2)?;
    }
    Ok(Some(asked.min(processors)))
}
