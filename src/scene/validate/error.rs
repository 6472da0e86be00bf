//! Error of a scene: the problem, its place, and the remedy.

use crate::scene::{CameraError, MeshError};
use std::fmt;

/// A part of a scene that an error is about.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ScenePart {
    /// A material.
    Material {
        /// Index into [`crate::scene::Scene::materials`].
        index: usize,
        /// Its name.
        name: String,
    },
    /// A texture.
    Texture {
        /// Index into [`crate::scene::Scene::textures`].
        index: usize,
        /// Its name.
        name: String,
    },
    /// A mix: an index into [`crate::scene::Scene::mixes`].
    Mix(usize),
    /// A light.
    Light {
        /// Index into [`crate::scene::Scene::lights`].
        index: usize,
        /// Its name.
        name: String,
    },
    /// The environment.
    Environment,
    /// A shape: an index into [`crate::scene::Scene::shapes`].
    Shape(usize),
    /// An instance of a shape.
    Instance {
        /// Index into [`crate::scene::Scene::shapes`].
        shape: usize,
        /// Index into [`crate::scene::Shape::instances`].
        index: usize,
    },
}

impl fmt::Display for ScenePart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Material { index, name } => write!(f, "material {index} ({name:?})"),
            Self::Texture { index, name } => write!(f, "texture {index} ({name:?})"),
            Self::Mix(index) => write!(f, "mix {index}"),
            Self::Light { index, name } => write!(f, "light {index} ({name:?})"),
            Self::Environment => f.write_str("the environment"),
            Self::Shape(index) => write!(f, "shape {index}"),
            Self::Instance { shape, index } => write!(f, "instance {index} of shape {shape}"),
        }
    }
}

/// Error of an invalid scene: the problem, its place, and the remedy.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The mesh is invalid.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A number is out of range or not finite.
    #[error("{part}: {field} is {value}; it must be {expected}")]
    Value {
        /// The part of the scene.
        part: ScenePart,
        /// The part's field.
        field: &'static str,
        /// The number.
        value: f32,
        /// The range.
        expected: &'static str,
    },
    /// An index names something that does not exist.
    #[error("{part}: {field} names {kind} {index}, but the scene has {count}; indices count from 0")]
    Index {
        /// The part of the scene.
        part: ScenePart,
        /// The part's field.
        field: &'static str,
        /// Kind of thing that the index names.
        kind: &'static str,
        /// The index.
        index: u32,
        /// Number of the kind.
        count: usize,
    },
    /// A surface of user code reads a vertex attribute that the mesh does not have.
    #[error("{part}: its surface reads the vertex attribute {name:?}, {reason}")]
    VertexAttribute {
        /// The material.
        part: ScenePart,
        /// The attribute's name.
        name: String,
        /// What the mesh has.
        reason: String,
    },
    /// An image has another number of texels than its size says.
    #[error("{part}: {found} texels for {width}x{height} pixels; there must be {expected}")]
    Texels {
        /// The texture or the environment.
        part: ScenePart,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Number of texels.
        found: usize,
        /// Right number of texels.
        expected: &'static str,
    },
    /// The mipmap levels of a texture are not those of its image.
    #[error(
        "{part}: its mipmap levels belong to another image; call Scene::add_mipmaps after changing images"
    )]
    Mipmap {
        /// The texture.
        part: ScenePart,
    },
    /// A mix contains itself.
    #[error("{part}: it contains itself; each of its parts must lead to a material that is no mix")]
    MixCycle {
        /// The mix.
        part: ScenePart,
    },
    /// A part of a mix has another emission, coverage or medium than the material of the mix.
    #[error("{part}: its {field} differs from that of {of}, which is a part of its mix; make them equal")]
    MixPart {
        /// The material of the mix.
        part: ScenePart,
        /// The field that differs.
        field: &'static str,
        /// The part.
        of: ScenePart,
    },
    /// A shape or an instance does not fit the mesh.
    #[error("{part}: {problem}")]
    Instance {
        /// The shape or the instance.
        part: ScenePart,
        /// The problem, and the remedy.
        problem: &'static str,
    },
    /// The parent of an object does not exist.
    #[error(
        "object {index}: its parent does not exist; there are {count} objects, whose indices count from 0"
    )]
    Parent {
        /// Index of the object.
        index: usize,
        /// Number of objects.
        count: usize,
    },
    /// The spaces of objects are of another table, or not finite.
    #[error("the object table has spaces of another number of objects, or numbers that are not finite")]
    ObjectSpaces,
    /// The scene's camera is invalid.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The animation of the scene's camera contains a number that is not finite.
    #[error("the camera's animation: a key of node {node} is not finite")]
    CameraMotion {
        /// Index of the animated node, from the root.
        node: usize,
    },
}
