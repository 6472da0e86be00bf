//! Arrays of the caller: what they may be, how they become contiguous, and how answers become arrays.

use numpy::{Element, PyArray, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyMemoryError, PyTypeError, PyValueError};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyDict;
use raystream_rays::memory::MemoryBudget;

/// Contiguous numbers of one kind, as an argument gave them or copied from it.
pub type Numbers<'py, T> = PyReadonlyArrayDyn<'py, T>;

/// A kind of number with its name in NumPy.
pub trait Named: Element {
    /// The name of the `dtype`.
    const NAME: &'static str;
}

impl Named for bool {
    const NAME: &'static str = "bool";
}

impl Named for f32 {
    const NAME: &'static str = "float32";
}

impl Named for f64 {
    const NAME: &'static str = "float64";
}

impl Named for i32 {
    const NAME: &'static str = "int32";
}

impl Named for i64 {
    const NAME: &'static str = "int64";
}

impl Named for u32 {
    const NAME: &'static str = "uint32";
}

impl Named for u8 {
    const NAME: &'static str = "uint8";
}

/// The module of NumPy.
pub fn numpy(py: Python<'_>) -> PyResult<&Bound<'_, PyModule>> {
    static NUMPY: PyOnceLock<Py<PyModule>> = PyOnceLock::new();
    Ok(NUMPY.get_or_try_init(py, || py.import("numpy").map(Bound::unbind))?.bind(py))
}

/// An argument as contiguous numbers of its kind, without a copy where it is so already. Takes arrays of NumPy, of
/// anything that speaks DLPack, and sequences.
///
/// # Errors
/// As NumPy's, with the argument's name before them.
pub fn numbers<'py, T: Named>(value: &Bound<'py, PyAny>, name: &str) -> PyResult<Numbers<'py, T>> {
    if let Ok(array) = value.cast::<PyArrayDyn<T>>()
        && array.is_c_contiguous()
    {
        return array.try_readonly().map_err(|error| of_argument(name, &error));
    }
    let py = value.py();
    let named = |error: PyErr| match error.is_instance_of::<PyMemoryError>(py) {
        true => error,
        false => of_argument(name, &error),
    };
    let array = converted(numpy(py)?, value, T::NAME).map_err(named)?;
    let array = array.cast_into::<PyArrayDyn<T>>().map_err(|error| of_argument(name, &error))?;
    array.try_readonly().map_err(|error| of_argument(name, &error))
}

/// An argument that is an array of exactly this kind, contiguous.
pub fn exactly<'py, T: Element>(value: &Bound<'py, PyAny>) -> Option<Numbers<'py, T>> {
    let array = value.cast::<PyArrayDyn<T>>().ok().filter(|array| array.is_c_contiguous())?;
    array.try_readonly().ok()
}

/// An argument as contiguous integers.
///
/// # Errors
/// For numbers with a fraction, and as for [`numbers`].
pub fn integers<'py>(value: &Bound<'py, PyAny>, name: &str) -> PyResult<Numbers<'py, i64>> {
    let (given, kind) = of_any_kind(value)?;
    let is_empty = given.getattr(intern!(value.py(), "size"))?.extract::<usize>()? == 0;
    if !matches!(kind, 'i' | 'u') && !is_empty {
        return Err(PyTypeError::new_err(format!("{name} must be integers")));
    }
    numbers(&given, name)
}

fn converted<'py>(
    numpy: &Bound<'py, PyModule>,
    value: &Bound<'py, PyAny>,
    kind: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let (py, array) = (numpy.py(), taken(numpy, value)?);
    let keywords = PyDict::new(py);
    keywords.set_item(intern!(py, "dtype"), kind)?;
    keywords.set_item(intern!(py, "order"), "C")?;
    numpy.call_method(intern!(py, "asarray"), (array,), Some(&keywords))
}

/// An array of another library as NumPy's; anything else as it is.
fn taken<'py>(numpy: &Bound<'py, PyModule>, value: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let py = numpy.py();
    let is_array = value.cast::<numpy::PyUntypedArray>().is_ok();
    if !is_array && value.hasattr(intern!(py, "__dlpack__"))? {
        return numpy.call_method1(intern!(py, "from_dlpack"), (value,));
    }
    Ok(value.clone())
}

/// An argument as an array of its own kind of number, and the kind's character in NumPy.
///
/// # Errors
/// As NumPy's.
pub fn of_any_kind<'py>(value: &Bound<'py, PyAny>) -> PyResult<(Bound<'py, PyAny>, char)> {
    let (py, numpy) = (value.py(), numpy(value.py())?);
    let array = numpy.call_method1(intern!(py, "asarray"), (taken(numpy, value)?,))?;
    let kind = array.getattr(intern!(py, "dtype"))?.getattr(intern!(py, "kind"))?.extract()?;
    Ok((array, kind))
}

fn of_argument(name: &str, error: &dyn std::fmt::Display) -> PyErr {
    PyValueError::new_err(format!("{name}: {error}"))
}

/// Checks that answers fit in memory.
///
/// # Errors
/// MemoryError with both numbers.
pub fn check_memory(what: &str, items: usize, bytes_each: usize) -> PyResult<()> {
    // Calls that are not large do not ask the system.
    let bytes = items as u128 * bytes_each as u128;
    if bytes < 64 << 20 {
        return Ok(());
    }
    let bytes = u64::try_from(bytes).unwrap_or(u64::MAX);
    MemoryBudget::of_machine().check(what, bytes).map_err(|error| PyMemoryError::new_err(error.to_string()))
}

/// As many zeros. The system provides their pages where they are first written, by the threads that do so.
///
/// # Errors
/// MemoryError if the system does not give it.
pub fn zeros<T: bytemuck::Zeroable>(items: usize) -> PyResult<Vec<T>> {
    let zeros = bytemuck::allocation::try_zeroed_slice_box(items);
    zeros.map(Vec::from).map_err(|()| PyMemoryError::new_err(format!("no memory for {items} answers")))
}

/// An array of numbers in the shape `leading`, with one more dimension where each answer has several.
pub fn array<'py, T: Element>(
    py: Python<'py>,
    numbers: Vec<T>,
    leading: &[usize],
    each: usize,
) -> PyResult<Bound<'py, PyAny>> {
    let flat = PyArray::from_vec(py, numbers);
    if each == 1 && leading.len() == 1 {
        return Ok(flat.into_any());
    }
    let mut shape = leading.to_vec();
    if each != 1 {
        shape.push(each);
    }
    Ok(flat.reshape(shape)?.into_any())
}

/// Points of an argument, `(.., 3)`: their leading shape.
///
/// # Errors
/// If the last dimension is not 3.
pub fn leading<T: Element>(array: &Numbers<'_, T>, last: usize, name: &str) -> PyResult<Vec<usize>> {
    match array.shape() {
        [leading @ .., length] if *length == last => Ok(leading.to_vec()),
        shape => {
            Err(PyValueError::new_err(format!("{name} have the shape {shape:?}; it must be (.., {last})")))
        }
    }
}
