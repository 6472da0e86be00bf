//! Render specs of arguments.

use crate::errors::raised;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyString};
use raystream::picture::RenderSpec;
use serde_json::{Map, Value};
use std::path::Path;

/// The spec of a file, of a dictionary, and of keywords; what comes later wins.
///
/// # Errors
/// ValueError with the file's line and column, for a key that is no option, and for a value that an option refuses;
/// TypeError for values that JSON does not have.
pub fn spec_of(
    options: Option<&Path>,
    dictionary: Option<&Bound<'_, PyDict>>,
    keywords: Option<&Bound<'_, PyDict>>,
) -> PyResult<RenderSpec> {
    let mut spec = match options {
        Some(path) => RenderSpec::read(path).map_err(|error| raised(&error.into()))?,
        None => RenderSpec::default(),
    };
    let mut set = |dictionary: &Bound<'_, PyDict>, is_keywords: bool| {
        dictionary.iter().try_for_each(|(key, value)| {
            let key: String = key.extract()?;
            let key = if is_keywords { key.replace('_', "-") } else { key };
            match json_of(&value).map_err(|error| named(value.py(), &key, &error))? {
                Value::Null => Ok(()),
                value => spec.set(&key, &value).map_err(|error| PyValueError::new_err(error.to_string())),
            }
        })
    };
    dictionary.map_or(Ok(()), |dictionary| set(dictionary, false))?;
    keywords.map_or(Ok(()), |keywords| set(keywords, true))?;
    Ok(spec)
}

/// A spec as a dictionary, without options that have their defaults.
///
/// # Errors
/// If Python has no memory.
pub fn dictionary_of<'py>(py: Python<'py>, spec: &RenderSpec) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(spec).map_err(|error| PyValueError::new_err(error.to_string()))?;
    python_of(py, &text)
}

/// JSON as Python's values.
///
/// # Errors
/// If it is none, or Python has no memory.
pub fn python_of<'py>(py: Python<'py>, json: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.call_method1("loads", (json,))
}

/// An error that begins with the name of its argument.
pub fn named(py: Python<'_>, key: &str, error: &PyErr) -> PyErr {
    PyErr::from_type(error.get_type(py), format!("{key}: {}", error.value(py)))
}

/// A value as JSON: numbers, also NumPy's, texts, paths, lists, tuples, arrays, dictionaries, None.
///
/// # Errors
/// TypeError for values that JSON does not have, ValueError for numbers that are not finite.
pub fn json_of(value: &Bound<'_, PyAny>) -> PyResult<Value> {
    let py = value.py();
    if value.is_none() {
        return Ok(Value::Null);
    }
    if value.is_instance_of::<PyBool>() {
        return Ok(Value::Bool(value.extract()?));
    }
    if value.is_instance_of::<PyInt>() {
        return match value.extract::<i64>() {
            Ok(number) => Ok(number.into()),
            Err(_) => Ok(value.extract::<u64>()?.into()),
        };
    }
    if value.is_instance_of::<PyFloat>() {
        let number: f64 = value.extract()?;
        let finite = serde_json::Number::from_f64(number);
        return finite
            .map(Value::Number)
            .ok_or_else(|| PyValueError::new_err(format!("{number} is not finite")));
    }
    if value.is_instance_of::<PyString>() {
        return Ok(Value::String(value.extract()?));
    }
    if let Ok(dictionary) = value.cast::<PyDict>() {
        let pair =
            |(key, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| Ok((key.extract()?, json_of(&value)?));
        return Ok(Value::Object(dictionary.iter().map(pair).collect::<PyResult<Map<_, _>>>()?));
    }
    if value.hasattr(intern!(py, "__fspath__"))? {
        return json_of(&value.call_method0(intern!(py, "__fspath__"))?);
    }
    // NumPy's numbers and arrays.
    if value.hasattr(intern!(py, "tolist"))? {
        return json_of(&value.call_method0(intern!(py, "tolist"))?);
    }
    let items = value.try_iter().map_err(|_| {
        PyTypeError::new_err(format!("takes numbers, texts, paths, True, False and lists, not {value}"))
    })?;
    Ok(Value::Array(items.map(|item| json_of(&item?)).collect::<PyResult<_>>()?))
}
