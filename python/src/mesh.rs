//! The class `Mesh`.

use crate::arrays::{Numbers, exactly, integers, leading, numbers};
use crate::calls::{Given, PointCall};
use crate::errors::raised;
use crate::queries::Queries;
use crate::rays::{Floats, rows_of};
use crate::target::{MeshTarget, Target, Vertices};
use crate::threads::Threads;
use glam::Vec3;
use numpy::{Element, PyArray, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use raystream::scene::load::{LoadOptions, load_with};
use raystream_rays::query::{self, OpenMesh};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A triangle mesh that answers questions about rays and points.
///
/// `vertices` are `(v, 3)` numbers, `faces` `(f, 3)` integers, rows of `vertices`; without faces, `vertices` are the
/// corners of triangles, `(f, 3, 3)`. Row i of `faces` is primitive i of an answer. Both sides of a triangle are hit;
/// triangles without area never are. The arrays are copied. **float32 vertices are taken as they are; float64 ones,
/// which may be far from the origin, are stored relative to the middle of their box**, in float32.
///
/// `attributes`, `(f,)`, are numbers that hits carry (the column attribute); `normals`, `(v, 3)`, are interpolated (the
/// column shading_normal). ValueError names the first vertex that is not finite or beyond 1e11, and the first face that
/// names no vertex.
///
/// >>> import raystream as rs
/// >>> mesh = rs.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
/// >>> hits = mesh.cast([0.25, 0.5, 2, 0, 0, -1])
/// >>> float(hits.t), int(hits.primitive)
/// (2.0, 0)
#[pyclass(module = "raystream", extends = Queries, frozen, weakref)]
#[derive(Debug)]
pub struct Mesh {}

/// Vertices and faces of arguments.
pub struct Geometry {
    pub vertices: Vertices,
    pub faces: Vec<[u32; 3]>,
}

impl Geometry {
    /// Reads `vertices` with `faces`, or corners of triangles without.
    ///
    /// # Errors
    /// For other shapes.
    pub fn new(vertices: &Bound<'_, PyAny>, faces: Given<'_, '_>) -> PyResult<Self> {
        let given = Floats::new(vertices, 3, "vertices")?;
        let leading = given.leading(3, "vertices")?;
        let faces = match (faces, leading.as_slice()) {
            (Some(faces), [_]) => faces_of(faces)?,
            (None, &[count, 3]) => {
                let corners =
                    u32::try_from(3 * count).map_err(|_| PyValueError::new_err("too many triangles"))?;
                (0..corners / 3).map(|face| [3 * face, 3 * face + 1, 3 * face + 2]).collect()
            }
            (Some(_), _) => return Err(PyValueError::new_err("vertices with faces must be (v, 3)")),
            (None, _) => return Err(PyValueError::new_err("vertices without faces must be (f, 3, 3)")),
        };
        Ok(Self { vertices: vertices_of(&given)?, faces })
    }
}

fn vertices_of(given: &Floats<'_>) -> PyResult<Vertices> {
    Ok(match given {
        Floats::F32(vertices) => Vertices::F32(Arc::new(rows_of(vertices)?.to_vec())),
        Floats::F64(vertices) => Vertices::F64(Arc::new(rows_of(vertices)?.to_vec())),
    })
}

fn build(vertices: &Vertices, faces: &[[u32; 3]]) -> Result<query::Mesh, query::GeometryError> {
    match vertices {
        Vertices::F32(vertices) => query::Mesh::build(vertices, faces),
        Vertices::F64(vertices) => query::Mesh::build64(vertices, faces),
    }
}

impl Mesh {
    /// The mesh of an object as it is now.
    ///
    /// # Errors
    /// While another thread changes it.
    pub fn of(slf: &Bound<'_, Self>) -> PyResult<MeshTarget> {
        slf.as_super().get().target()?.mesh().cloned()
    }

    /// A new object of a mesh.
    ///
    /// # Errors
    /// If Python has no memory.
    pub fn from_target(py: Python<'_>, target: MeshTarget) -> PyResult<Py<Self>> {
        let queries = Queries::of(Target::Mesh(target));
        Py::new(py, PyClassInitializer::from(queries).add_subclass(Self {}))
    }

    /// The mesh of an object and its number of open edges, which is counted at the first call.
    fn with_open_edges(slf: &Bound<'_, Self>) -> PyResult<(query::Mesh, usize)> {
        let target = Self::of(slf)?;
        if let Some(edges) = target.open_edges {
            return Ok((target.mesh, edges));
        }
        let edges = Threads::all()?.run(slf.py(), || target.mesh.open_edges());
        slf.as_super().get().change(|now| match now {
            // Not if it was refitted meanwhile.
            Target::Mesh(now) if Arc::ptr_eq(now.mesh.bvh(), target.mesh.bvh()) => {
                now.open_edges = Some(edges)
            }
            _ => {}
        })?;
        Ok((target.mesh, edges))
    }

    /// The mesh, if it has an inside or `allow_open` says that parity is meant.
    fn with_inside(slf: &Bound<'_, Self>, allow_open: bool) -> PyResult<query::Mesh> {
        if allow_open {
            return Ok(Self::of(slf)?.mesh);
        }
        match Self::with_open_edges(slf)? {
            (mesh, 0) => Ok(mesh),
            (_, edges) => Err(PyValueError::new_err(format!("{} (allow_open=True)", OpenMesh { edges }))),
        }
    }
}

#[pymethods]
impl Mesh {
    #[new]
    #[pyo3(signature = (vertices, faces=None, attributes=None, *, normals=None, threads=None))]
    fn new(
        py: Python<'_>,
        vertices: &Bound<'_, PyAny>,
        faces: Given<'_, '_>,
        attributes: Given<'_, '_>,
        normals: Given<'_, '_>,
        threads: Option<usize>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let Geometry { vertices, faces } = Geometry::new(vertices, faces)?;
        let attributes = attributes.map(|given| numbers::<f32>(given, "attributes")).transpose()?;
        let normals = normals.map(|given| numbers::<f32>(given, "normals")).transpose()?;
        let attributes = attributes.map(|given| checked(&given, &[faces.len()], "attributes")).transpose()?;
        let normals = normals.map(|given| checked(&given, &[vertices.len(), 3], "normals")).transpose()?;
        let mesh =
            Threads::new(threads, usize::MAX, 0)?.run(py, || build(&vertices, &faces)).map_err(defect)?;
        let normals = normals.map(|numbers| Arc::new(numbers.as_chunks().0.to_vec()));
        let (faces, attributes) = (Arc::new(faces), attributes.map(Arc::new));
        let target = MeshTarget { mesh, vertices, faces, attributes, normals, open_edges: None };
        Ok(PyClassInitializer::from(Queries::of(Target::Mesh(target))).add_subclass(Self {}))
    }

    /// Moves the vertices, as many as before: several times as fast as a new mesh, whose answers it gives to the bit.
    /// Rays become slower to trace as neighbouring triangles move away from each other. Calls of other threads that
    /// have begun see the mesh as it was. float64 vertices are stored relative to the middle of their new box: each
    /// coordinate is wrong by at most 2**-24 of its distance from the middle.
    #[pyo3(signature = (vertices, *, threads=None))]
    fn refit(slf: &Bound<'_, Self>, vertices: &Bound<'_, PyAny>, threads: Option<usize>) -> PyResult<()> {
        let (py, before) = (slf.py(), Self::of(slf)?);
        let given = Floats::new(vertices, 3, "vertices")?;
        let (found, expected) = (given.leading(3, "vertices")?, before.vertices.len());
        if found != [expected] {
            return Err(PyValueError::new_err(format!(
                "vertices {found:?} for a mesh of [{expected}]; make a new one"
            )));
        }
        drop(before);
        let (threads, vertices) = (Threads::new(threads, usize::MAX, 0)?, vertices_of(&given)?);
        slf.as_super()
            .get()
            .change(|target| {
                let Target::Mesh(target) = target else { return Ok(()) };
                threads.run(py, || {
                    match &vertices {
                        Vertices::F32(vertices) => target.mesh.refit(vertices, &target.faces)?,
                        Vertices::F64(vertices) => target.mesh.refit64(vertices, &target.faces)?,
                    }
                    (target.vertices, target.open_edges) = (vertices, None);
                    Ok(())
                })
            })?
            .map_err(defect)
    }

    /// For each point, `(.., 3)`, True if it is inside the mesh or exactly on its surface: a bool array in the shape of
    /// the points. Exact. ValueError for a mesh with open edges, unless `allow_open`: then points are inside from which
    /// one ray crosses the mesh an odd number of times.
    #[pyo3(signature = (points, *, allow_open=false, out=None, threads=None))]
    fn contains<'py>(
        slf: &Bound<'py, Self>,
        points: &Bound<'py, PyAny>,
        allow_open: bool,
        out: Given<'_, 'py>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let mesh = Self::with_inside(slf, allow_open)?;
        let call = PointCall::new(points, out, threads)?;
        call.each(slf.py(), |points, inside| mesh.contains_by_parity(points, inside))
    }

    /// The distance of each point, `(.., 3)`, from the surface, **negative inside**: a float32 array in the shape of
    /// the points. Errors and `allow_open` are those of `contains`.
    #[pyo3(signature = (points, *, allow_open=false, out=None, threads=None))]
    fn signed_distance<'py>(
        slf: &Bound<'py, Self>,
        points: &Bound<'py, PyAny>,
        allow_open: bool,
        out: Given<'_, 'py>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let mesh = Self::with_inside(slf, allow_open)?;
        let call = PointCall::new(points, out, threads)?;
        call.each(slf.py(), |points, distances| mesh.signed_distances_by_parity(points, distances))
    }

    /// The number of edges that an odd number of triangles have, by the positions of their ends. Counted at the first
    /// look.
    #[getter]
    fn open_edges(slf: &Bound<'_, Self>) -> PyResult<usize> {
        Ok(Self::with_open_edges(slf)?.1)
    }

    /// True if the mesh has an inside: no edge is open.
    #[getter]
    fn is_closed(slf: &Bound<'_, Self>) -> PyResult<bool> {
        Ok(Self::with_open_edges(slf)?.1 == 0)
    }

    /// A copy of the vertices, `(v, 3)`, in their kind.
    #[getter]
    fn vertices<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        match Self::of(slf)?.vertices {
            Vertices::F32(vertices) => copy(slf.py(), &vertices),
            Vertices::F64(vertices) => copy(slf.py(), &vertices),
        }
    }

    /// A copy of the faces, uint32 `(f, 3)`.
    #[getter]
    fn faces<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        copy(slf.py(), &Self::of(slf)?.faces)
    }

    /// A copy of the attributes, float32 `(f,)`, or None.
    #[getter]
    fn attributes<'py>(slf: &Bound<'py, Self>) -> PyResult<Option<Bound<'py, PyAny>>> {
        Ok(Self::of(slf)?.attributes.map(|numbers| PyArray::from_slice(slf.py(), &numbers).into_any()))
    }

    /// A copy of the normals, float32 `(v, 3)`, or None.
    #[getter]
    fn normals<'py>(slf: &Bound<'py, Self>) -> PyResult<Option<Bound<'py, PyAny>>> {
        Self::of(slf)?.normals.map(|normals| copy(slf.py(), &normals)).transpose()
    }

    /// Number of triangles.
    #[getter]
    fn triangle_count(slf: &Bound<'_, Self>) -> PyResult<usize> {
        Ok(Self::of(slf)?.faces.len())
    }

    fn __copy__(slf: &Bound<'_, Self>) -> PyResult<Py<Self>> {
        Self::from_target(slf.py(), Self::of(slf)?)
    }

    fn __deepcopy__(slf: &Bound<'_, Self>, _memo: &Bound<'_, PyAny>) -> PyResult<Py<Self>> {
        Self::__copy__(slf)
    }

    fn __getnewargs_ex__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyTuple>, Bound<'py, PyDict>)> {
        let (py, keywords) = (slf.py(), PyDict::new(slf.py()));
        keywords.set_item("attributes", Self::attributes(slf)?)?;
        keywords.set_item("normals", Self::normals(slf)?)?;
        Ok((PyTuple::new(py, [Self::vertices(slf)?, Self::faces(slf)?])?, keywords))
    }

    fn __getstate__(&self) {}

    fn __repr__(slf: &Bound<'_, Self>) -> PyResult<String> {
        let target = Self::of(slf)?;
        Ok(format!("Mesh({} vertices, {} triangles)", target.vertices.len(), target.faces.len()))
    }
}

/// The triangles of a file as one mesh: .obj, .ply, .stl, .off, .gltf, .glb or a recipe, .json. Row i of its faces is
/// triangle i of `raystream render`'s scene: those of the file in their order, with instances written out. Vertices are
/// float32, `normals` those of the file. Textures that are missing do not matter.
///
/// FileNotFoundError and its like if the file cannot be read, ValueError with the place for what is wrong in it.
#[pyfunction]
#[pyo3(signature = (path, *, threads=None))]
pub fn load(py: Python<'_>, path: PathBuf, threads: Option<usize>) -> PyResult<Py<Mesh>> {
    let target = Threads::new(threads, usize::MAX, 0)?.run(py, || loaded(&path));
    Mesh::from_target(py, target.map_err(|error| raised(&error))?)
}

fn loaded(path: &Path) -> anyhow::Result<MeshTarget> {
    let scene = load_with(path, &LoadOptions::default().with_allow_missing(true))?;
    for warning in &scene.warnings {
        log::warn!(target: "raystream", "{}: {warning}", path.display());
    }
    let rows = |vectors: &[Vec3]| Arc::new(bytemuck::cast_slice::<Vec3, [f32; 3]>(vectors).to_vec());
    let (vertices, faces) = (rows(&scene.mesh.positions), Arc::new(scene.mesh.triangles.clone()));
    let normals = (!scene.mesh.normals.is_empty()).then(|| rows(&scene.mesh.normals));
    let mesh = query::Mesh::build(&vertices, &faces)?;
    let vertices = Vertices::F32(vertices);
    Ok(MeshTarget { mesh, vertices, faces, attributes: None, normals, open_edges: None })
}

/// A defect of geometry as Python's error.
fn defect(error: query::GeometryError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Numbers of an argument that has this shape.
pub fn checked(given: &Numbers<'_, f32>, shape: &[usize], name: &str) -> PyResult<Vec<f32>> {
    if given.shape() != shape {
        let found = given.shape();
        return Err(PyValueError::new_err(format!("{name} have the shape {found:?}; it must be {shape:?}")));
    }
    Ok(given.as_slice()?.to_vec())
}

/// Rows as an array.
fn copy<'py, T: Element + Copy>(py: Python<'py>, rows: &[[T; 3]]) -> PyResult<Bound<'py, PyAny>> {
    Ok(PyArray::from_slice(py, rows.as_flattened()).reshape([rows.len(), 3])?.into_any())
}

/// Integers of the argument `faces`.
pub fn faces_of(faces: &Bound<'_, PyAny>) -> PyResult<Vec<[u32; 3]>> {
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
