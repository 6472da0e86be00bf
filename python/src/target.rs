//! A mesh or a world as it is at the time of a call.

use crate::calls::Asked;
use crate::columns::Want;
use crate::memory::OfInstances;
use glam::{DMat4, Vec3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use raystream_rays::query::{self, VertexNormals};
use std::sync::Arc;

/// What answers a question. Clones share memory.
#[derive(Clone, Debug)]
pub enum Target {
    Mesh(MeshTarget),
    World(Arc<WorldTarget>),
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

/// A world, with what it was made of.
#[derive(Clone, Debug, Default)]
pub struct WorldTarget {
    pub world: query::World,
    /// By number; `None` where an instance was removed.
    pub instances: Vec<Option<Instance>>,
    /// Number of changes.
    pub changes: u64,
    /// True if the tree over the instances is there.
    pub is_built: bool,
}

/// A mesh at a place.
#[derive(Clone, Debug)]
pub struct Instance {
    pub mesh: MeshTarget,
    pub transform: DMat4,
    pub is_visible: bool,
}

impl WorldTarget {
    /// Number of triangles, those of all instances that are seen.
    pub fn triangle_count(&self) -> usize {
        let seen = self.instances.iter().flatten().filter(|instance| instance.is_visible);
        seen.map(|instance| instance.mesh.faces.len()).sum()
    }

    /// Makes the tree over the instances.
    pub fn build(&mut self) {
        // The first question makes it.
        self.world.occluded_one(&query::Ray::new([0.0; 3], [0.0; 3]));
        self.is_built = true;
    }
}

/// Vertices as they were given.
#[derive(Clone, Debug)]
pub enum Vertices {
    F32(Arc<Vec<[f32; 3]>>),
    F64(Arc<Vec<[f64; 3]>>),
}

impl Vertices {
    /// The vertices in `f32`.
    pub fn rounded(&self) -> Vec<Vec3> {
        match self {
            Self::F32(vertices) => vertices.iter().copied().map(Vec3::from).collect(),
            Self::F64(vertices) => {
                vertices.iter().map(|vertex| vertex.map(|number| number as f32).into()).collect()
            }
        }
    }

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

    /// The world.
    ///
    /// # Errors
    /// For a mesh.
    pub fn world(&self) -> PyResult<&Arc<WorldTarget>> {
        match self {
            Self::World(target) => Ok(target),
            Self::Mesh(_) => Err(PyValueError::new_err("only a world has this, not a mesh")),
        }
    }

    /// The world, to be changed: copied first if calls are at it.
    ///
    /// # Errors
    /// For a mesh.
    pub fn world_mut(&mut self) -> PyResult<&mut WorldTarget> {
        match self {
            Self::World(target) => Ok(Arc::make_mut(target)),
            Self::Mesh(_) => Err(PyValueError::new_err("only a world has this, not a mesh")),
        }
    }

    /// The meshes of instances, `None` for those that cannot be hit; one for a mesh.
    fn meshes(&self) -> Vec<Option<&MeshTarget>> {
        let world = match self {
            Self::Mesh(target) => return vec![Some(target)],
            Self::World(target) => target,
        };
        let seen = world.instances.iter().map(|of| of.as_ref().filter(|instance| instance.is_visible));
        seen.map(|instance| Some(&instance?.mesh)).collect()
    }

    /// What each mesh that can be hit has, and nothing for others.
    ///
    /// # Errors
    /// If a mesh lacks it.
    fn each<'a, T: Default>(
        &'a self,
        what: &str,
        of: impl Fn(&'a MeshTarget) -> Option<T>,
    ) -> PyResult<Vec<T>> {
        let (meshes, alone) = (self.meshes(), matches!(self, Self::Mesh(_)));
        let whose = |at| if alone { "the mesh".into() } else { format!("the mesh of instance {at}") };
        let missing =
            |at| PyValueError::new_err(format!("{} has no {what}; pass {what}= when it is made", whose(at)));
        let each = |(at, mesh): (usize, Option<&'a MeshTarget>)| match mesh {
            Some(mesh) => of(mesh).ok_or_else(|| missing(at)),
            None => Ok(T::default()),
        };
        meshes.into_iter().enumerate().map(each).collect()
    }

    /// Numbers of the triangles of each instance.
    ///
    /// # Errors
    /// If a mesh has none.
    pub fn attributes(&self) -> PyResult<Vec<&[f32]>> {
        self.each("attributes", |mesh| Some(mesh.attributes.as_ref()?.as_slice()))
    }

    /// Numbers of the triangles of one instance after the other, by instance.
    ///
    /// # Errors
    /// If there is not one for each triangle.
    pub fn attributes_of<'a>(&self, all: &'a [f32]) -> PyResult<Vec<&'a [f32]>> {
        let counts = self.meshes().into_iter().map(|mesh| mesh.map_or(0, |mesh| mesh.faces.len()));
        let counts: Vec<usize> = counts.collect();
        let (found, expected) = (all.len(), counts.iter().sum::<usize>());
        if found != expected {
            return Err(PyValueError::new_err(format!(
                "attribute has {found} numbers for {expected} triangles"
            )));
        }
        let mut rest = all;
        let first = |count| {
            let (first, others) = rest.split_at(count);
            rest = others;
            first
        };
        Ok(counts.into_iter().map(first).collect())
    }

    /// What wanted columns read.
    ///
    /// # Errors
    /// If a mesh lacks it.
    pub fn of_instances(&self, want: &Want) -> PyResult<OfInstances<'_>> {
        let mut of = OfInstances::default();
        if want.has("attribute") {
            of.attributes = self.attributes()?;
        }
        if want.has("shading_normal") {
            of.normals = self.each("normals", |mesh| {
                Some(VertexNormals { normals: mesh.normals.as_ref()?, triangles: &mesh.faces })
            })?;
        }
        Ok(of)
    }
}
