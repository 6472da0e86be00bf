//! The triangle mesh.

use crate::geom::{Aabb, MAX_COORDINATE};
use glam::{Vec2, Vec3, Vec4};

/// An indexed triangle mesh. Row `i` of `triangles` is primitive `i` everywhere.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Vertex positions, world space.
    pub positions: Vec<Vec3>,
    /// Unit shading normals per vertex; empty, or as long as `positions`. A zero vector means the
    /// vertex has none and the geometric normal counts.
    pub normals: Vec<Vec3>,
    /// Texture coordinates per vertex, (0, 0) at the *first row* of an image (glTF's convention; the
    /// OBJ loader flips v); empty, or as long as `positions`.
    pub uvs: Vec<Vec2>,
    /// Tangents per vertex (w = handedness), as glTF has them; empty, or as long as `positions`. A
    /// zero vector means the vertex has none and it is derived from the texture coordinates.
    pub tangents: Vec<Vec4>,
    /// Vertex indices; counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Material index per triangle.
    pub materials: Vec<u32>,
}

/// What is wrong with a mesh.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// A coordinate is NaN, infinite or too large.
    #[error(
        "vertex {index} is at ({x}, {y}, {z}); coordinates must be finite and at most {MAX_COORDINATE:e} in size"
    )]
    Position {
        /// Vertex index.
        index: usize,
        /// Its coordinates.
        x: f32,
        /// Its coordinates.
        y: f32,
        /// Its coordinates.
        z: f32,
    },
    /// A triangle names a vertex that is not there.
    #[error(
        "triangle {triangle} names vertex {vertex}, but there are {count} vertices (0 to {})",
        count.saturating_sub(1)
    )]
    Vertex {
        /// Triangle index.
        triangle: usize,
        /// The index it names.
        vertex: u32,
        /// How many there are.
        count: usize,
    },
    /// A triangle names a material that is not there.
    #[error("triangle {triangle} names material {material}, but there are {count}")]
    Material {
        /// Triangle index.
        triangle: usize,
        /// The index it names.
        material: u32,
        /// How many there are.
        count: usize,
    },
    /// A per-vertex attribute has another length than the positions.
    #[error("{attribute}: {found} entries for {expected} vertices")]
    Attribute {
        /// Its name.
        attribute: &'static str,
        /// Its length.
        found: usize,
        /// The number of vertices.
        expected: usize,
    },
    /// Nothing to render.
    #[error("the scene has no triangles")]
    Empty,
    /// More triangles than primitive ids (bit 31 is reserved, as are the ids' last values).
    #[error("{found} triangles; at most {max} can be numbered")]
    TooMany {
        /// How many there are.
        found: usize,
        /// How many there may be.
        max: usize,
    },
}

/// The most triangles a scene may have.
pub const MAX_TRIANGLES: usize = (1 << 28) - 1;

impl Mesh {
    /// The box around all vertices that triangles use.
    pub fn bounds(&self) -> Aabb {
        Aabb::around(self.triangles.iter().flatten().map(|&i| self.positions[i as usize]))
    }

    /// Corner positions of a triangle.
    pub fn corners(&self, primitive: u32) -> [Vec3; 3] {
        // Not `map`, which is not always inlined; shading asks for every hit.
        let [a, b, c] = self.triangles[primitive as usize];
        [self.positions[a as usize], self.positions[b as usize], self.positions[c as usize]]
    }

    /// Texture coordinates at barycentric (`u`, `v`); zero where the mesh has none.
    pub fn uv_at(&self, primitive: u32, u: f32, v: f32) -> Vec2 {
        if self.uvs.is_empty() {
            return Vec2::ZERO;
        }
        let [a, b, c] = self.triangles[primitive as usize];
        let [a, b, c] = [self.uvs[a as usize], self.uvs[b as usize], self.uvs[c as usize]];
        a * (1.0 - u - v) + b * u + c * v
    }

    /// Checks what [`crate::scene::Scene`] promises.
    ///
    /// # Errors
    /// The first thing that is wrong, with its index.
    pub fn validate(&self, materials: usize) -> Result<(), MeshError> {
        let expected = self.positions.len();
        for (attribute, found) in [
            ("normals", self.normals.len()),
            ("texture coordinates", self.uvs.len()),
            ("tangents", self.tangents.len()),
        ] {
            if found != 0 && found != expected {
                return Err(MeshError::Attribute { attribute, found, expected });
            }
        }
        if self.materials.len() != self.triangles.len() {
            return Err(MeshError::Attribute {
                attribute: "materials per triangle",
                found: self.materials.len(),
                expected: self.triangles.len(),
            });
        }
        if self.triangles.is_empty() {
            return Err(MeshError::Empty);
        }
        if self.triangles.len() > MAX_TRIANGLES {
            return Err(MeshError::TooMany { found: self.triangles.len(), max: MAX_TRIANGLES });
        }
        // NaN fails the comparison too.
        if let Some(index) =
            self.positions.iter().position(|p| !p.abs().cmple(Vec3::splat(MAX_COORDINATE)).all())
        {
            let [x, y, z] = self.positions[index].to_array();
            return Err(MeshError::Position { index, x, y, z });
        }
        for (triangle, (corners, &material)) in self.triangles.iter().zip(&self.materials).enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&i| i as usize >= expected) {
                return Err(MeshError::Vertex { triangle, vertex, count: expected });
            }
            if material as usize >= materials {
                return Err(MeshError::Material { triangle, material, count: materials });
            }
        }
        Ok(())
    }
}
