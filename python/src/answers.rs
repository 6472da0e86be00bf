//! Answers with named columns.

use crate::arrays::numpy;
use pyo3::exceptions::{PyAttributeError, PyKeyError};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::pyclass::CompareOp;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyList, PyTuple};
use std::fmt;

/// Columns of an answer, arrays that have the same leading shape as the question.
///
/// A column is an attribute, `hits.t`, and an item, `hits["t"]`. A miss has `t` = +inf, `primitive` and `instance` =
/// -1, and zeros in every other column.
#[pyclass(module = "raystream", frozen, mapping)]
pub struct Hits {
    columns: Vec<(String, Py<PyAny>)>,
    /// The column [`RAY`] of lists, which is computed when it is asked for.
    ray: PyOnceLock<Py<PyAny>>,
}

/// The index of the ray of each hit, which follows from [`OFFSETS`].
const RAY: &str = "ray";

/// For each ray of a list the index of its first hit, and the number of all hits.
const OFFSETS: &str = "offsets";

impl fmt::Debug for Hits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Hits").field("columns", &self.columns).finish_non_exhaustive()
    }
}

impl Hits {
    /// Of these columns.
    pub fn of(columns: Vec<(&str, Bound<'_, PyAny>)>) -> Self {
        let named = |(name, array): (&str, Bound<'_, PyAny>)| (name.to_string(), array.unbind());
        Self { columns: columns.into_iter().map(named).collect(), ray: PyOnceLock::new() }
    }

    /// With more columns before these.
    pub fn with(mut self, columns: Vec<(&str, Bound<'_, PyAny>)>) -> Self {
        self.columns.splice(0..0, Self::of(columns).columns);
        self
    }

    fn find(&self, name: &str) -> Option<&Py<PyAny>> {
        self.columns.iter().find(|(known, _)| known == name).map(|(_, array)| array)
    }

    /// True if the column [`RAY`] is computed from others.
    fn computes_ray(&self) -> bool {
        self.find(OFFSETS).is_some() && self.find(RAY).is_none()
    }

    fn names(&self) -> Vec<&str> {
        let mut names: Vec<&str> = self.columns.iter().map(|(name, _)| name.as_str()).collect();
        if self.computes_ray() {
            names.insert(1, RAY);
        }
        names
    }

    /// The column of a name.
    fn column(&self, py: Python<'_>, name: &str) -> PyResult<Option<Py<PyAny>>> {
        let found = match self.find(OFFSETS) {
            Some(offsets) if name == RAY && self.computes_ray() => {
                let made = self.ray.get_or_try_init(py, || rays_of(offsets.bind(py)));
                Some(made?)
            }
            _ => self.find(name),
        };
        Ok(found.map(|array| array.clone_ref(py)))
    }

    /// All columns with their names.
    fn all(&self, py: Python<'_>) -> PyResult<Vec<(&str, Py<PyAny>)>> {
        let column = |name| Ok((name, self.column(py, name)?.expect("it is one of the names")));
        self.names().into_iter().map(column).collect()
    }

    /// The columns in a dictionary.
    pub fn dictionary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dictionary = PyDict::new(py);
        for (name, array) in self.all(py)? {
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
        let columns = columns.iter().map(column).collect::<PyResult<_>>()?;
        Ok(Self { columns, ray: PyOnceLock::new() })
    }

    fn __getattr__(&self, py: Python<'_>, name: &str) -> PyResult<Py<PyAny>> {
        let missing = || format!("there is no column {name:?}; want= asked for {}", self.names().join(", "));
        self.column(py, name)?.ok_or_else(|| PyAttributeError::new_err(missing()))
    }

    fn __getitem__(&self, py: Python<'_>, name: &str) -> PyResult<Py<PyAny>> {
        self.column(py, name)?.ok_or_else(|| PyKeyError::new_err(name.to_string()))
    }

    fn __len__(&self) -> usize {
        self.names().len()
    }

    fn __contains__(&self, name: &str) -> bool {
        self.names().contains(&name)
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
    fn values(&self, py: Python<'_>) -> PyResult<Vec<Py<PyAny>>> {
        Ok(self.all(py)?.into_iter().map(|(_, array)| array).collect())
    }

    /// Pairs of names and arrays.
    fn items(&self, py: Python<'_>) -> PyResult<Vec<(&str, Py<PyAny>)>> {
        self.all(py)
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
        let mut columns = self.all(py)?;
        columns.sort_by_key(|(name, _)| *name);
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
        let column = |(name, array): (&str, Py<PyAny>)| -> PyResult<String> {
            let array = array.bind(py);
            Ok(format!("{name}: {}{}", array.getattr("dtype")?, array.getattr("shape")?))
        };
        let columns = self.all(py)?.into_iter().map(column).collect::<PyResult<Vec<_>>>()?;
        Ok(format!("Hits({})", columns.join(", ")))
    }
}

/// The index of the ray of each hit of lists with these offsets.
fn rays_of(offsets: &Bound<'_, PyAny>) -> PyResult<Py<PyAny>> {
    let numpy = numpy(offsets.py())?;
    let counts = numpy.call_method1("diff", (offsets,))?;
    let rays = numpy.call_method1("arange", (counts.len()?,))?;
    let dtype = offsets.getattr("dtype")?;
    let rays = rays.call_method1("astype", (dtype,))?;
    Ok(numpy.call_method1("repeat", (rays, counts))?.unbind())
}
