//! Errors of the engine as Python's.

use pyo3::exceptions::{PyMemoryError, PyOSError, PyValueError};
use pyo3::prelude::*;
use raystream::memory::OutOfMemory;
use raystream::picture::{SpecError, with_causes};
use raystream::scene::load::{LoadError, LoadProblem};
use std::io;

/// An error as ValueError; as OSError (FileNotFoundError and so on) if the system refused something, and as MemoryError
/// if memory lacks.
pub fn raised(error: &anyhow::Error) -> PyErr {
    let told = with_causes(error);
    let problem = error.chain().find_map(|cause| Some(cause.downcast_ref::<LoadError>()?.problem()));
    let lacks_memory = error.chain().any(|cause| cause.is::<OutOfMemory>());
    if lacks_memory || matches!(problem, Some(LoadProblem::Memory { .. })) {
        return PyMemoryError::new_err(told);
    }
    let system = match problem {
        Some(LoadProblem::Read { source, .. }) => Some(source),
        _ => error.chain().find_map(|cause| cause.downcast_ref::<io::Error>()),
    };
    let of_spec = || error.chain().find_map(|cause| cause.downcast_ref::<SpecError>()?.os_error());
    match system.map(io::Error::raw_os_error).or_else(|| of_spec().map(Some)) {
        Some(Some(number)) => PyOSError::new_err((number, told)),
        Some(None) => PyOSError::new_err(told),
        None => PyValueError::new_err(told),
    }
}
