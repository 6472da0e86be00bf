//! The class `Mesh`.

use crate::arrays::{Numbers, exactly, integers, leading, numbers};
use crate::interim::Target;
use crate::queries::Queries;
use crate::rays::rows_of;
use crate::threads::Threads;
use numpy::{PyArray, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use raystream_rays::query;
use std::sync::{Arc, Mutex, PoisonError};

/// The most triangles that are built on the calling thread.
const FEW_TRIANGLES: usize = 1024;

/// A triangle mesh that answers questions about rays and points.
///
/// `vertices` are `(v, 3)` numbers, `faces` `(f, 3)` integers, rows of `vertices`; without faces, `vertices` are the
/// corners of triangles, `(f, 3, 3)`. Row i of `faces` is primitive i of an answer. Both sides of a triangle are hit;
/// triangles without area never are. The arrays are copied. ValueError names the first vertex that is not finite or
/// beyond 1e11, and the first face that names no vertex.
///
/// >>> import raystream as rs
/// >>> mesh = rs.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
/// >>> hits = mesh.cast([0.25, 0.5, 2, 0, 0, -1])
/// >>> float(hits.t), int(hits.primitive)
/// (2.0, 0)
#[pyclass(module = "raystream", extends = Queries, frozen, weakref)]
#[derive(Debug)]
pub struct Mesh {
    vertices: Mutex<Arc<Vec<[f32; 3]>>>,
    faces: Arc<Vec<[u32; 3]>>,
}

impl Mesh {
    fn positions(&self) -> Arc<Vec<[f32; 3]>> {
        self.vertices.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The mesh of an object as it is now.
    pub fn query(slf: &Bound<'_, Self>) -> PyResult<query::Mesh> {
        match slf.as_super().get().target()? {
            Target::Mesh(mesh) => Ok(mesh),
            Target::World(_) => Err(PyValueError::new_err("not a mesh")),
        }
    }
}

#[pymethods]
impl Mesh {
    #[new]
    #[pyo3(signature = (vertices, faces=None, *, threads=None))]
    fn new(
        py: Python<'_>,
        vertices: &Bound<'_, PyAny>,
        faces: Option<&Bound<'_, PyAny>>,
        threads: Option<usize>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let given = numbers::<f32>(vertices, "vertices")?;
        let (vertices, faces) = match faces {
            Some(faces) => {
                leading(&given, 3, "vertices")?;
                (rows_of(&given)?.to_vec(), faces_of(faces)?)
            }
            None => soup(&given)?,
        };
        let threads = Threads::new(threads, faces.len(), FEW_TRIANGLES)?;
        let mesh = threads.run(py, || query::Mesh::build(&vertices, &faces)).map_err(of_geometry)?;
        let this = Self { vertices: Mutex::new(Arc::new(vertices)), faces: Arc::new(faces) };
        Ok(PyClassInitializer::from(Queries::of(Target::Mesh(mesh))).add_subclass(this))
    }

    /// Moves the vertices, as many as before: several times as fast as a new mesh. Rays become slower to trace as
    /// neighbouring triangles move away from each other. Calls of other threads that have begun see the mesh as it was.
    #[pyo3(signature = (vertices, *, threads=None))]
    fn refit(slf: &Bound<'_, Self>, vertices: &Bound<'_, PyAny>, threads: Option<usize>) -> PyResult<()> {
        let (py, this) = (slf.py(), slf.get());
        let given = numbers::<f32>(vertices, "vertices")?;
        leading(&given, 3, "vertices")?;
        let (vertices, expected) = (rows_of(&given)?, this.positions().len());
        if vertices.len() != expected {
            let found = vertices.len();
            return Err(PyValueError::new_err(format!("{found} vertices for a mesh of {expected}; make a new one")));
        }
        let threads = Threads::new(threads, this.faces.len(), FEW_TRIANGLES)?;
        slf.as_super().get().change(|target| match target {
            Target::Mesh(mesh) => threads.run(py, || mesh.refit(vertices, &this.faces)).map_err(of_geometry),
            Target::World(_) => Ok(()),
        })??;
        *this.vertices.lock().unwrap_or_else(PoisonError::into_inner) = Arc::new(vertices.to_vec());
        Ok(())
    }

    /// A copy of the vertices, float32 `(v, 3)`.
    #[getter]
    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let vertices = self.positions();
        let flat = PyArray::from_slice(py, vertices.as_flattened());
        Ok(flat.reshape([vertices.len(), 3])?.into_any())
    }

    /// A copy of the faces, uint32 `(f, 3)`.
    #[getter]
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let flat = PyArray::from_slice(py, self.faces.as_flattened());
        Ok(flat.reshape([self.faces.len(), 3])?.into_any())
    }

    /// Number of triangles.
    #[getter]
    fn triangle_count(&self) -> usize {
        self.faces.len()
    }

    fn __copy__(slf: &Bound<'_, Self>) -> PyResult<Py<Self>> {
        let this = slf.get();
        let copy = Self { vertices: Mutex::new(this.positions()), faces: this.faces.clone() };
        let queries = Queries::of(slf.as_super().get().target()?);
        Py::new(slf.py(), PyClassInitializer::from(queries).add_subclass(copy))
    }

    fn __deepcopy__(slf: &Bound<'_, Self>, _memo: &Bound<'_, PyAny>) -> PyResult<Py<Self>> {
        Self::__copy__(slf)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let (py, this) = (slf.py(), slf.get());
        let arguments = PyTuple::new(py, [this.vertices(py)?, this.faces(py)?])?;
        PyTuple::new(py, [slf.get_type().into_any(), arguments.into_any()])
    }

    fn __repr__(&self) -> String {
        format!("Mesh({} vertices, {} triangles)", self.positions().len(), self.faces.len())
    }
}

/// A defect of geometry as Python's error.
fn of_geometry(error: query::GeometryError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Three corners of each triangle.
fn soup(given: &Numbers<'_, f32>) -> PyResult<(Vec<[f32; 3]>, Vec<[u32; 3]>)> {
    let [count, 3, 3] = *given.shape() else {
        let shape = given.shape();
        return Err(PyValueError::new_err(format!("vertices without faces have the shape {shape:?}, not (f, 3, 3)")));
    };
    let corners = u32::try_from(3 * count).map_err(|_| PyValueError::new_err("there are too many triangles"))?;
    Ok((rows_of(given)?.to_vec(), (0..corners / 3).map(|face| [3 * face, 3 * face + 1, 3 * face + 2]).collect()))
}

/// Integers of the argument `faces`.
fn faces_of(faces: &Bound<'_, PyAny>) -> PyResult<Vec<[u32; 3]>> {
    if let Some(given) = exactly::<u32>(faces) {
        leading(&given, 3, "faces")?;
        return Ok(given.as_slice()?.as_chunks().0.to_vec());
    }
    let given = integers(faces, "faces")?;
    leading(&given, 3, "faces")?;
    let index = |(place, &vertex): (usize, &i64)| {
        u32::try_from(vertex)
            .map_err(|_| PyValueError::new_err(format!("faces: face {} names vertex {vertex}", place / 3)))
    };
    let flat = given.as_slice()?.iter().enumerate().map(index).collect::<PyResult<Vec<u32>>>()?;
    Ok(flat.as_chunks().0.to_vec())
}
