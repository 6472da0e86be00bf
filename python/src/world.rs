//! The class `World`.

use crate::arrays::{Numbers, integers, numbers};
use crate::mesh::Mesh;
use crate::queries::Queries;
use crate::target::{Instance, Target, WorldTarget};
use glam::DMat4;
use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyList, PyTuple};
use raystream_rays::query::WorldError;
use std::sync::Arc;

/// Meshes at many places, which answer questions together. A mesh is stored once, however many instances of it there
/// are;
/// `instance` of an answer is the number that `add` returned. Instances come, go, hide and move without a new tree of
/// their meshes.
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
pub struct World {}

/// State of a world in a pickle: meshes, then the mesh, transform and visibility of each instance.
type Pickled = (Vec<Py<Mesh>>, Vec<Option<(usize, [[f64; 4]; 4], bool)>>);

impl World {
    /// Changes the world; `moves` says that it keeps its tree.
    fn change<T>(
        slf: &Bound<'_, Self>,
        moves: bool,
        change: impl FnOnce(&mut WorldTarget) -> Result<T, WorldError>,
    ) -> PyResult<T> {
        let changed = slf.as_super().get().change(|target| {
            let target = target.world_mut()?;
            target.changes += 1;
            target.is_built &= moves;
            change(target).map_err(defect)
        });
        changed?
    }

    fn now(slf: &Bound<'_, Self>) -> PyResult<Arc<WorldTarget>> {
        slf.as_super().get().target()?.world().cloned()
    }

    /// Puts an instance into a world.
    fn insert(target: &mut WorldTarget, instance: Instance) -> Result<u32, WorldError> {
        let id = target.world.add(instance.mesh.mesh.clone(), instance.transform)?;
        target.world.set_visible(id, instance.is_visible)?;
        target.instances.push(Some(instance));
        Ok(id)
    }
}

#[pymethods]
impl World {
    #[new]
    fn new() -> PyClassInitializer<Self> {
        PyClassInitializer::from(Queries::of(Target::World(Arc::default()))).add_subclass(Self {})
    }

    /// Adds an instance of a mesh, moved by `transform`, `(4, 4)` or `(3, 4)`, the identity by default. Returns its
    /// number. A mesh that is refitted later stays here as it was: see `set_mesh`.
    #[pyo3(signature = (mesh, transform=None))]
    fn add(
        slf: &Bound<'_, Self>,
        mesh: &Bound<'_, Mesh>,
        transform: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<u32> {
        let transform = match transform {
            Some(transform) => matrices(transform)?.first().copied().unwrap_or(DMat4::IDENTITY),
            None => DMat4::IDENTITY,
        };
        let instance = Instance { mesh: Mesh::of(mesh)?, transform, is_visible: true };
        Self::change(slf, false, |target| Self::insert(target, instance))
    }

    /// Removes instances, one number or several. The others keep their numbers.
    fn remove(slf: &Bound<'_, Self>, ids: &Bound<'_, PyAny>) -> PyResult<()> {
        let ids = checked(slf, ids)?;
        Self::change(slf, false, |target| {
            ids.iter().try_for_each(|&id| {
                target.instances[id as usize] = None;
                target.world.remove(id)
            })
        })
    }

    /// Hides instances from all questions, or shows them again: `ids` is one number or several.
    fn set_visible(slf: &Bound<'_, Self>, ids: &Bound<'_, PyAny>, visible: bool) -> PyResult<()> {
        let ids = checked(slf, ids)?;
        Self::change(slf, false, |target| {
            ids.iter().try_for_each(|&id| {
                if let Some(instance) = &mut target.instances[id as usize] {
                    instance.is_visible = visible;
                }
                target.world.set_visible(id, visible)
            })
        })
    }

    /// Replaces the mesh of instances, such as by one that was refitted: `ids` is one number or several.
    fn set_mesh(slf: &Bound<'_, Self>, ids: &Bound<'_, PyAny>, mesh: &Bound<'_, Mesh>) -> PyResult<()> {
        let (ids, mesh) = (checked(slf, ids)?, Mesh::of(mesh)?);
        Self::change(slf, false, |target| {
            ids.iter().try_for_each(|&id| {
                target.world.set_mesh(id, mesh.mesh.clone())?;
                if let Some(instance) = &mut target.instances[id as usize] {
                    instance.mesh = mesh.clone();
                }
                Ok(())
            })
        })
    }

    /// Moves instances: `ids` is a number or `(k,)` of them, `transforms` `(4, 4)` or `(k, 4, 4)`. If one of the
    /// transforms is refused, none is moved.
    fn set_transforms(
        slf: &Bound<'_, Self>,
        ids: &Bound<'_, PyAny>,
        transforms: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let (ids, transforms) = (checked(slf, ids)?, matrices(transforms)?);
        if ids.len() != transforms.len() {
            let (found, expected) = (transforms.len(), ids.len());
            return Err(PyValueError::new_err(format!("{found} transforms for {expected} instances")));
        }
        Self::change(slf, true, |target| {
            target.world.move_some(&ids, &transforms)?;
            for (&id, &transform) in ids.iter().zip(&transforms) {
                if let Some(instance) = &mut target.instances[id as usize] {
                    instance.transform = transform;
                }
            }
            Ok(())
        })
    }

    fn __len__(slf: &Bound<'_, Self>) -> PyResult<usize> {
        Ok(Self::now(slf)?.instances.iter().flatten().count())
    }

    fn __copy__(slf: &Bound<'_, Self>) -> PyResult<Py<Self>> {
        let queries = Queries::of(Target::World(Self::now(slf)?));
        Py::new(slf.py(), PyClassInitializer::from(queries).add_subclass(Self {}))
    }

    fn __deepcopy__(slf: &Bound<'_, Self>, _memo: &Bound<'_, PyAny>) -> PyResult<Py<Self>> {
        Self::__copy__(slf)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let (py, instances, meshes) = (slf.py(), PyList::empty(slf.py()), PyList::empty(slf.py()));
        let mut known = Vec::new();
        for instance in &Self::now(slf)?.instances {
            let Some(Instance { mesh, transform, is_visible }) = instance else {
                instances.append(py.None())?;
                continue;
            };
            let tree = Arc::as_ptr(mesh.mesh.bvh());
            let index = match known.iter().position(|other| *other == tree) {
                Some(index) => index,
                None => {
                    known.push(tree);
                    meshes.append(Mesh::from_target(py, mesh.clone())?)?;
                    known.len() - 1
                }
            };
            instances.append((index, transform.transpose().to_cols_array_2d(), is_visible))?;
        }
        let state = PyTuple::new(py, [meshes, instances])?;
        PyTuple::new(py, [slf.get_type().into_any(), PyTuple::empty(py).into_any(), state.into_any()])
    }

    fn __setstate__(slf: &Bound<'_, Self>, state: Pickled) -> PyResult<()> {
        let (meshes, instances) = state;
        let meshes = meshes.iter().map(|mesh| Mesh::of(mesh.bind(slf.py()))).collect::<PyResult<Vec<_>>>()?;
        let Some(any) = meshes.first() else { return Ok(()) };
        Self::change(slf, false, |target| {
            for instance in instances {
                let (mesh, rows, is_visible) =
                    instance.unwrap_or((0, DMat4::IDENTITY.to_cols_array_2d(), false));
                let transform = DMat4::from_cols_array_2d(&rows).transpose();
                let mesh = meshes.get(mesh).unwrap_or(any).clone();
                let id = Self::insert(target, Instance { mesh, transform, is_visible })?;
                if instance.is_none() {
                    target.instances[id as usize] = None;
                    target.world.remove(id)?;
                }
            }
            Ok(())
        })
    }

    fn __repr__(slf: &Bound<'_, Self>) -> PyResult<String> {
        let target = Self::now(slf)?;
        let count = target.instances.iter().flatten().count();
        Ok(format!("World({count} instances, {} triangles)", target.triangle_count()))
    }
}

/// A defect of instances as Python's error.
fn defect(error: WorldError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Numbers of instances that are there.
///
/// # Errors
/// IndexError for others.
fn checked(slf: &Bound<'_, World>, ids: &Bound<'_, PyAny>) -> PyResult<Vec<u32>> {
    let (ids, target): (Numbers<'_, i64>, _) = (integers(ids, "ids")?, World::now(slf)?);
    let id = |&id: &i64| {
        let found =
            u32::try_from(id).ok().filter(|&id| matches!(target.instances.get(id as usize), Some(Some(_))));
        found.ok_or_else(|| PyIndexError::new_err(format!("there is no instance {id}")))
    };
    ids.as_slice()?.iter().map(id).collect()
}

/// Matrices `(4, 4)` or `(3, 4)`, one or several.
///
/// # Errors
/// For other shapes.
pub fn matrices(given: &Bound<'_, PyAny>) -> PyResult<Vec<DMat4>> {
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
