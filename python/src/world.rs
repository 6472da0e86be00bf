//! The class `World`.

use crate::arrays::{integers, numbers};
use crate::mesh::Mesh;
use crate::queries::Queries;
use crate::target::{Target, WorldTarget};
use crate::threads::Threads;
use glam::DMat4;
use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyList, PyTuple};
use raystream_rays::query;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Meshes at many places, which answer questions about rays together. A mesh is stored once, however many instances of
/// it there are; `instance` of an answer is the number that `add` returned.
///
/// >>> import numpy as np, raystream as rs
/// >>> world, mesh = rs.World(), rs.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
/// >>> ids = [world.add(mesh), world.add(mesh)]
/// >>> moved = np.eye(4)
/// >>> moved[2, 3] = 1.5
/// >>> world.set_transforms(ids[1], moved)
/// >>> hits = world.cast([0.25, 0.5, 2, 0, 0, -1], want="t instance")
/// >>> float(hits.t), int(hits.instance)
/// (0.5, 1)
#[pyclass(module = "raystream", extends = Queries, frozen, weakref)]
#[derive(Debug)]
pub struct World {
    instances: Mutex<Vec<Instance>>,
}

/// A mesh at a place.
#[derive(Debug)]
struct Instance {
    mesh: Py<Mesh>,
    transform: DMat4,
}

impl World {
    fn locked(&self) -> MutexGuard<'_, Vec<Instance>> {
        self.instances.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Makes the tree over the instances.
    fn rebuild(slf: &Bound<'_, Self>) -> PyResult<()> {
        let py = slf.py();
        let instance = |instance: &Instance| {
            let mesh = Mesh::of(instance.mesh.bind(py))?.mesh;
            // Its tree lies about its centre.
            let transform = instance.transform * DMat4::from_translation(mesh.center());
            Ok((mesh, transform))
        };
        let instances = slf.get().locked().iter().map(instance).collect::<PyResult<Vec<_>>>()?;
        let triangles = instances.iter().map(|(mesh, _)| mesh.triangle_count()).sum();
        let world = Threads::all()?.run(py, || query::World::build(&instances));
        let world = world.map_err(|error| PyValueError::new_err(error.to_string()))?;
        slf.as_super().get().change(|target| *target = Target::World(WorldTarget { world, triangles }))
    }
}

#[pymethods]
impl World {
    #[new]
    fn new() -> PyResult<PyClassInitializer<Self>> {
        let nothing: [(query::Mesh, DMat4); 0] = [];
        let world =
            query::World::build(&nothing).map_err(|error| PyValueError::new_err(error.to_string()))?;
        Ok(PyClassInitializer::from(Queries::of(Target::World(WorldTarget { world, triangles: 0 })))
            .add_subclass(Self { instances: Mutex::default() }))
    }

    /// Adds an instance of a mesh, moved by `transform`, `(4, 4)` or `(3, 4)`, the identity by default. Returns its
    /// number.
    #[pyo3(signature = (mesh, transform=None))]
    fn add(
        slf: &Bound<'_, Self>,
        mesh: &Bound<'_, Mesh>,
        transform: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<usize> {
        let transform = match transform {
            Some(transform) => transforms(transform)?.first().copied().unwrap_or(DMat4::IDENTITY),
            None => DMat4::IDENTITY,
        };
        let number = slf.get().locked().len();
        slf.get().locked().push(Instance { mesh: mesh.clone().unbind(), transform });
        Self::rebuild(slf).inspect_err(|_| drop(slf.get().locked().pop()))?;
        Ok(number)
    }

    /// Moves instances: `ids` is a number or `(k,)` of them, `transforms` `(4, 4)` or `(k, 4, 4)`.
    fn set_transforms(
        slf: &Bound<'_, Self>,
        ids: &Bound<'_, PyAny>,
        transforms: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let (ids, transforms) = (integers(ids, "ids")?, self::transforms(transforms)?);
        let ids = ids.as_slice()?;
        if ids.len() != transforms.len() {
            let (found, expected) = (transforms.len(), ids.len());
            return Err(PyValueError::new_err(format!("{found} transforms for {expected} instances")));
        }
        {
            let mut instances = slf.get().locked();
            for (&id, &transform) in ids.iter().zip(&transforms) {
                let instance = usize::try_from(id).ok().and_then(|id| instances.get_mut(id));
                instance
                    .ok_or_else(|| PyIndexError::new_err(format!("there is no instance {id}")))?
                    .transform = transform;
            }
        }
        Self::rebuild(slf)
    }

    fn __len__(&self) -> usize {
        self.locked().len()
    }

    fn __copy__(slf: &Bound<'_, Self>) -> PyResult<Py<Self>> {
        let py = slf.py();
        let copy = |instance: &Instance| Instance {
            mesh: instance.mesh.clone_ref(py),
            transform: instance.transform,
        };
        let instances = slf.get().locked().iter().map(copy).collect();
        let queries = Queries::of(slf.as_super().get().target()?);
        Py::new(py, PyClassInitializer::from(queries).add_subclass(Self { instances: Mutex::new(instances) }))
    }

    /// The class, nothing to make it of, and its instances: pickling keeps meshes that are shared.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let py = slf.py();
        let instances = PyList::empty(py);
        for Instance { mesh, transform } in slf.get().locked().iter() {
            instances.append((mesh.clone_ref(py), transform.transpose().to_cols_array_2d()))?;
        }
        PyTuple::new(py, [slf.get_type().into_any(), PyTuple::empty(py).into_any(), instances.into_any()])
    }

    fn __setstate__(slf: &Bound<'_, Self>, instances: Vec<(Py<Mesh>, [[f64; 4]; 4])>) -> PyResult<()> {
        let instance =
            |(mesh, rows)| Instance { mesh, transform: DMat4::from_cols_array_2d(&rows).transpose() };
        *slf.get().locked() = instances.into_iter().map(instance).collect();
        Self::rebuild(slf)
    }

    fn __deepcopy__(slf: &Bound<'_, Self>, _memo: &Bound<'_, PyAny>) -> PyResult<Py<Self>> {
        Self::__copy__(slf)
    }
}

/// Matrices `(4, 4)` or `(3, 4)`, one or several.
fn transforms(given: &Bound<'_, PyAny>) -> PyResult<Vec<DMat4>> {
    let given = numbers::<f64>(given, "transform")?;
    let rows = match *given.shape() {
        [rows, 4] | [_, rows, 4] if rows == 3 || rows == 4 => rows,
        ref shape => {
            return Err(PyValueError::new_err(format!(
                "transforms have the shape {shape:?}; it must be (.., 4, 4)"
            )));
        }
    };
    let matrix = |given: &[[f64; 4]]| {
        let mut rows = DMat4::IDENTITY.to_cols_array_2d();
        rows[..given.len()].copy_from_slice(given);
        DMat4::from_cols_array_2d(&rows).transpose()
    };
    Ok(given.as_slice()?.as_chunks().0.chunks(rows).map(matrix).collect())
}
