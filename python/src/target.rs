//! A mesh or a world as it is at the time of a call.

use crate::calls::Asked;
use crate::columns::Want;
use crate::memory::OfMesh;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use raystream_rays::query;
use std::sync::Arc;

/// What answers a question. Clones share memory.
#[derive(Clone, Debug)]
pub enum Target {
    Mesh(MeshTarget),
    World(WorldTarget),
}

/// A mesh with what it was made of.
#[derive(Clone, Debug)]
pub struct MeshTarget {
    pub mesh: query::Mesh,
    pub vertices: Vertices,
    pub faces: Arc<Vec<[u32; 3]>>,
    /// A number for each triangle.
    pub attributes: Option<Arc<Vec<f32>>>,
    /// A normal for each vertex.
    pub normals: Option<Arc<Vec<[f32; 3]>>>,
    /// Number of open edges, once it is known.
    pub open_edges: Option<usize>,
}

/// A world with its number of triangles, those of all instances.
#[derive(Clone, Debug)]
pub struct WorldTarget {
    pub world: query::World,
    pub triangles: usize,
}

/// Vertices as they were given.
#[derive(Clone, Debug)]
pub enum Vertices {
    F32(Arc<Vec<[f32; 3]>>),
    F64(Arc<Vec<[f64; 3]>>),
}

impl Vertices {
    /// Number of vertices.
    pub fn len(&self) -> usize {
        match self {
            Self::F32(vertices) => vertices.len(),
            Self::F64(vertices) => vertices.len(),
        }
    }
}

impl Target {
    /// The queries.
    pub fn asked(&self) -> Asked<'_> {
        match self {
            Self::Mesh(target) => &target.mesh,
            Self::World(target) => &target.world,
        }
    }

    /// The mesh.
    ///
    /// # Errors
    /// For a world.
    pub fn mesh(&self) -> PyResult<&MeshTarget> {
        match self {
            Self::Mesh(target) => Ok(target),
            Self::World(_) => Err(PyValueError::new_err("only a mesh has this, not a world")),
        }
    }

    /// Numbers of the triangles of a mesh.
    ///
    /// # Errors
    /// If it has none.
    pub fn attributes(&self) -> PyResult<&[f32]> {
        let missing =
            || PyValueError::new_err("the mesh has no attributes; pass attributes= when it is made");
        self.mesh()?.attributes.as_ref().map(|attributes| attributes.as_slice()).ok_or_else(missing)
    }

    /// Checks that there is a number for each triangle.
    ///
    /// # Errors
    /// If there is not.
    pub fn check_attributes(&self, found: usize) -> PyResult<()> {
        let expected = match self {
            Self::Mesh(target) => target.faces.len(),
            Self::World(target) => target.triangles,
        };
        if found == expected {
            return Ok(());
        }
        Err(PyValueError::new_err(format!("attribute has {found} numbers for {expected} triangles")))
    }

    /// What wanted columns read.
    ///
    /// # Errors
    /// If the mesh lacks it.
    pub fn of_mesh(&self, want: &Want) -> PyResult<OfMesh<'_>> {
        let mut of = OfMesh::default();
        if want.has("attribute") {
            of.attributes = self.attributes()?;
        }
        if want.has("shading_normal") {
            let mesh = self.mesh()?;
            let missing = || PyValueError::new_err("the mesh has no normals; pass normals= when it is made");
            of.normals = mesh.normals.as_ref().ok_or_else(missing)?;
            of.triangles = &mesh.faces;
        }
        Ok(of)
    }
}
