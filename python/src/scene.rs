//! The class `Scene`, and what a scene may be given as.

use crate::arrays::{leading, numbers};
use crate::calls::Given;
use crate::mesh::{Mesh, checked, faces_of};
use crate::rays::rows_of;
use crate::target::Vertices;
use crate::threads::Threads;
use glam::{Vec2, Vec3, Vec4};
use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use raystream::scene;
use raystream::scene::load::scene_of_mesh;

/// A mesh with what it looks like, to be rendered.
///
/// `vertices` are `(v, 3)` numbers, `faces` `(f, 3)` integers, rows of `vertices`. `normals`, `(v, 3)`, are
/// interpolated (flat triangles without them; 0 for a vertex that has none); `colours`, `(v, 3)` or `(v, 4)`, linear, 0
/// to 1, are the reflectance and, if there is a fourth column, the alpha; `uvs`, `(v, 2)`, are what shaders and the
/// layer uv see, with (0, 0) at the first row of an image. All are stored in float32. The material is matte and named
/// "default" (the option `material` changes it), the object "mesh". ValueError names the first vertex, face or number
/// that is wrong.
///
/// >>> import raystream as rs
/// >>> scene = rs.Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], colours=[[1, 0, 0], [0, 1, 0], [0, 0, 1]])
/// >>> rs.render(scene, size=(32, 32), spp=4).image.shape
/// (32, 32, 3)
#[pyclass(module = "raystream", frozen)]
#[derive(Debug)]
pub struct Scene {
    scene: scene::Scene,
}

#[pymethods]
impl Scene {
    #[new]
    #[pyo3(signature = (vertices, faces, *, normals=None, colours=None, uvs=None))]
    fn new(
        py: Python<'_>,
        vertices: &Bound<'_, PyAny>,
        faces: &Bound<'_, PyAny>,
        normals: Given<'_, '_>,
        colours: Given<'_, '_>,
        uvs: Given<'_, '_>,
    ) -> PyResult<Self> {
        let vertices = numbers::<f32>(vertices, "vertices")?;
        leading(&vertices, 3, "vertices")?;
        let positions: Vec<Vec3> = rows_of(&vertices)?.iter().copied().map(Vec3::from).collect();
        let count = positions.len();
        let mut mesh = scene::TriangleMesh::new(positions, faces_of(faces)?);
        if let Some(normals) = normals {
            let normals = checked(&numbers(normals, "normals")?, &[count, 3], "normals")?;
            mesh.normals = normals.as_chunks::<3>().0.iter().copied().map(Vec3::from).collect();
        }
        if let Some(colours) = colours {
            let colours = numbers::<f32>(colours, "colours")?;
            let channels = if colours.shape().last() == Some(&4) { 4 } else { 3 };
            let colours = checked(&colours, &[count, channels], "colours")?;
            let colour = |row: &[f32]| Vec4::new(row[0], row[1], row[2], row.get(3).copied().unwrap_or(1.0));
            mesh.colours = colours.chunks_exact(channels).map(colour).collect();
        }
        if let Some(uvs) = uvs {
            let uvs = checked(&numbers(uvs, "uvs")?, &[count, 2], "uvs")?;
            mesh.uvs = uvs.as_chunks::<2>().0.iter().copied().map(Vec2::from).collect();
        }
        Self::of(py, mesh)
    }

    /// Number of triangles.
    #[getter]
    fn triangle_count(&self) -> usize {
        self.scene.mesh.triangles.len()
    }

    /// The corners of the box around all triangles, float32 `(2, 3)`: the least and the greatest coordinates.
    #[getter]
    fn bounds<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let bounds = self.scene.bounds();
        crate::arrays::array(py, [bounds.min.to_array(), bounds.max.to_array()].concat(), &[2], 3)
    }

    fn __repr__(&self) -> String {
        let mesh = &self.scene.mesh;
        format!("Scene({} vertices, {} triangles)", mesh.positions.len(), mesh.triangles.len())
    }
}

impl Scene {
    /// A checked scene of a mesh.
    fn of(py: Python<'_>, mesh: scene::TriangleMesh) -> PyResult<Self> {
        Threads::all()?.run(py, || {
            let scene = scene_of_mesh(mesh, "mesh");
            scene.map(|scene| Self { scene }).map_err(|error| PyValueError::new_err(error.to_string()))
        })
    }

    /// The scene, which shares its mesh.
    pub fn scene(&self) -> scene::Scene {
        self.scene.clone()
    }

    /// A scene of a mesh that answers questions, with its normals.
    ///
    /// # Errors
    /// If the mesh has no triangles.
    pub fn of_mesh(mesh: &Bound<'_, Mesh>) -> PyResult<Self> {
        let target = Mesh::of(mesh)?;
        let positions = match &target.vertices {
            Vertices::F32(vertices) => vertices.iter().copied().map(Vec3::from).collect(),
            Vertices::F64(vertices) => {
                vertices.iter().map(|vertex| vertex.map(|number| number as f32).into()).collect()
            }
        };
        let mut scene = scene::TriangleMesh::new(positions, target.faces.to_vec());
        if let Some(normals) = target.normals {
            scene.normals = normals.iter().copied().map(Vec3::from).collect();
        }
        Self::of(mesh.py(), scene)
    }
}
