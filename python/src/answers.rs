//! Answers with named columns.

use crate::arrays::numpy;
use pyo3::exceptions::{PyAttributeError, PyKeyError};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::pyclass::CompareOp;
use pyo3::types::{PyDict, PyList, PyTuple};

/// Columns of an answer, arrays that have the same leading shape as the question.
///
/// A column is an attribute, `hits.t`, and an item, `hits["t"]`. A miss has `t` = +inf, `primitive` and `instance` =
/// -1, and zeros in every other column.
#[pyclass(module = "raystream", frozen, mapping)]
#[derive(Debug)]
pub struct Hits {
    columns: Vec<(String, Py<PyAny>)>,
}

impl Hits {
    /// Of these columns.
    pub fn of(columns: Vec<(&str, Bound<'_, PyAny>)>) -> Self {
        Self {
            columns: columns.into_iter().map(|(name, array)| (name.to_string(), array.unbind())).collect(),
        }
    }

    /// With more columns before these.
    pub fn with(mut self, columns: Vec<(&str, Bound<'_, PyAny>)>) -> Self {
        self.columns.splice(0..0, Self::of(columns).columns);
        self
    }

    fn find(&self, name: &str) -> Option<&Py<PyAny>> {
        self.columns.iter().find(|(known, _)| known == name).map(|(_, array)| array)
    }

    fn names(&self) -> Vec<&str> {
        self.columns.iter().map(|(name, _)| name.as_str()).collect()
    }

    /// The columns in a dictionary.
    pub fn dictionary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dictionary = PyDict::new(py);
        for (name, array) in &self.columns {
            dictionary.set_item(name, array)?;
        }
        Ok(dictionary)
    }
}

#[pymethods]
impl Hits {
    #[new]
    fn new(columns: &Bound<'_, PyDict>) -> PyResult<Self> {
        let column =
            |(name, array): (Bound<'_, PyAny>, Bound<'_, PyAny>)| Ok((name.extract()?, array.unbind()));
        Ok(Self { columns: columns.iter().map(column).collect::<PyResult<_>>()? })
    }

    fn __getattr__(&self, py: Python<'_>, name: &str) -> PyResult<Py<PyAny>> {
        let missing = || format!("there is no column {name:?}; want= asked for {}", self.names().join(", "));
        self.find(name).map(|array| array.clone_ref(py)).ok_or_else(|| PyAttributeError::new_err(missing()))
    }

    fn __getitem__(&self, py: Python<'_>, name: &str) -> PyResult<Py<PyAny>> {
        let found = self.find(name).map(|array| array.clone_ref(py));
        found.ok_or_else(|| PyKeyError::new_err(name.to_string()))
    }

    fn __len__(&self) -> usize {
        self.columns.len()
    }

    fn __contains__(&self, name: &str) -> bool {
        self.find(name).is_some()
    }

    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(PyList::new(py, self.names())?.try_iter()?.into_any())
    }

    fn __dir__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        let names = slf.get_type().call_method0("mro")?.get_item(0)?.dir()?;
        slf.get().names().iter().try_for_each(|name| names.append(name))?;
        Ok(names.into_any())
    }

    /// Names of the columns.
    fn keys(&self) -> Vec<&str> {
        self.names()
    }

    /// The arrays of the columns.
    fn values(&self, py: Python<'_>) -> Vec<Py<PyAny>> {
        self.columns.iter().map(|(_, array)| array.clone_ref(py)).collect()
    }

    /// Pairs of names and arrays.
    fn items(&self, py: Python<'_>) -> Vec<(&str, Py<PyAny>)> {
        self.columns.iter().map(|(name, array)| (name.as_str(), array.clone_ref(py))).collect()
    }

    /// True where a ray has hit something: a bool array in the shape of the rays.
    #[getter]
    fn hit<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        if let Some(primitive) = self.find("primitive") {
            return primitive.bind(py).rich_compare(0, CompareOp::Ge);
        }
        let t = self.find("t").or_else(|| self.find("distance"));
        let t =
            t.ok_or_else(|| PyAttributeError::new_err("hit needs the column primitive, t or distance"))?;
        numpy(py)?.call_method1(intern!(py, "isfinite"), (t,))
    }

    /// SHA-256 of the columns, in hexadecimal: of their names, kinds, shapes and bytes, in the order of the names. The
    /// same answers have the same hash on every machine, instruction set and number of threads.
    fn hash<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let digest = py.import("hashlib")?.call_method0("sha256")?;
        let mut columns: Vec<_> = self.columns.iter().collect();
        columns.sort_by_key(|(name, _)| name.as_str());
        let numpy = numpy(py)?;
        for (name, array) in columns {
            let array = array.bind(py);
            let head =
                format!("{name} {} {};", array.getattr("dtype")?.getattr("name")?, array.getattr("shape")?);
            let array = numpy.call_method1(intern!(py, "ascontiguousarray"), (array,))?;
            digest.call_method1("update", (head.as_bytes(),))?;
            digest.call_method1("update", (array,))?;
        }
        digest.call_method0("hexdigest")
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let py = slf.py();
        let arguments = PyTuple::new(py, [slf.get().dictionary(py)?])?;
        PyTuple::new(py, [slf.get_type().into_any(), arguments.into_any()])
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let column = |(name, array): &(String, Py<PyAny>)| -> PyResult<String> {
            let array = array.bind(py);
            Ok(format!("{name}: {}{}", array.getattr("dtype")?, array.getattr("shape")?))
        };
        let columns = self.columns.iter().map(column).collect::<PyResult<Vec<_>>>()?;
        Ok(format!("Hits({})", columns.join(", ")))
    }
}
