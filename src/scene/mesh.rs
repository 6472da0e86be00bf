//! The triangle mesh.

#[cfg(doc)]
use super::TextureRef;
use super::VertexAttribute;
use crate::geom::{Aabb, MAX_COORDINATE};
use glam::{DVec3, Vec2, Vec3, Vec4};
use rayon::prelude::*;

/// An indexed triangle mesh. Row `i` of `triangles` is primitive `i` everywhere.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct TriangleMesh {
    /// Vertex positions in world space.
    pub positions: Vec<Vec3>,
    /// Unit shading normals, one per vertex. Either empty or as long as `positions`. A zero vector means that the
    /// vertex has no normal; the geometric normal is then used.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, one pair per vertex. (0, 0) is at the *first row* of an image (glTF's convention; the OBJ
    /// loader flips v). Either empty or as long as `positions`.
    pub uvs: Vec<Vec2>,
    /// Further sets of texture coordinates: `more_uvs[k]` is set `k + 1` of [`TextureRef::set`], and `uvs` is set 0.
    /// Each is either empty or as long as `positions`; all are empty if `uvs` is.
    pub more_uvs: Vec<Vec<Vec2>>,
    /// Colours, one per vertex: linear Rec. 709 and alpha, 0..=1. Materials whose colours say so
    /// ([`super::Colour::vertex`]) are multiplied by them. Either empty or as long as `positions`.
    pub colours: Vec<Vec4>,
    /// Tangents, one per vertex, as in glTF (w is the handedness). Either empty or as long as `positions`. A zero
    /// vector means that the vertex has no tangent, which is then derived from the texture coordinates.
    pub tangents: Vec<Vec4>,
    /// Attributes with names of their own, which surfaces of user code read. Their names differ.
    pub attributes: Vec<VertexAttribute>,
    /// Vertex indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Material index, one per triangle.
    pub materials: Vec<u32>,
}

/// Error of an invalid mesh.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// A coordinate is NaN, infinite or too large.
    #[error(
        "vertex {index} is at ({x}, {y}, {z}); coordinates must be finite and at most {MAX_COORDINATE:e} in magnitude"
    )]
    Position {
        /// Vertex index.
        index: usize,
        /// The vertex's x coordinate.
        x: f32,
        /// The vertex's y coordinate.
        y: f32,
        /// The vertex's z coordinate.
        z: f32,
    },
    /// A triangle names a vertex that does not exist.
    #[error(
        "triangle {triangle} names vertex {vertex}, but there are {count} vertices (0 to {})",
        count.saturating_sub(1)
    )]
    Vertex {
        /// Triangle index.
        triangle: usize,
        /// The vertex index.
        vertex: u32,
        /// Number of vertices.
        count: usize,
    },
    /// A triangle names a material that does not exist.
    #[error("triangle {triangle} names material {material}, but there are {count} materials")]
    Material {
        /// Triangle index.
        triangle: usize,
        /// The material index.
        material: u32,
        /// Number of materials.
        count: usize,
    },
    /// A per-vertex attribute contains NaN or infinity.
    #[error("{attribute}: the entry of vertex {vertex} is not finite; use zeros for vertices without one")]
    NotFinite {
        /// The attribute's name.
        attribute: &'static str,
        /// Vertex index.
        vertex: usize,
    },
    /// A colour is out of range.
    #[error("colours: vertex {vertex} has {value}; colours are linear, from 0 to 1")]
    Colour {
        /// Vertex index.
        vertex: usize,
        /// The channel's value.
        value: f32,
    },
    /// A per-vertex attribute has another length than the positions.
    #[error("{attribute}: {found} entries for {expected} vertices")]
    Attribute {
        /// The attribute's name.
        attribute: &'static str,
        /// Its length.
        found: usize,
        /// Number of vertices.
        expected: usize,
    },
    /// An attribute with a name of its own has no valid number of values a vertex.
    #[error("the attribute {name:?} has {width} numbers a vertex; from 1 to 4 are supported")]
    AttributeWidth {
        /// The attribute's name.
        name: String,
        /// Its numbers of a vertex.
        width: u32,
    },
    /// An attribute with a name of its own has too few or too many values.
    #[error("the attribute {name:?}: {found} numbers; the vertices have {expected}")]
    NamedAttribute {
        /// The attribute's name.
        name: String,
        /// Its length.
        found: usize,
        /// The numbers of all vertices.
        expected: usize,
    },
    /// An attribute with a name of its own contains NaN or infinity.
    #[error(
        "the attribute {name:?}: a number of vertex {vertex} is not finite; use zeros for vertices without one"
    )]
    NamedNotFinite {
        /// The attribute's name.
        name: String,
        /// Vertex index.
        vertex: usize,
    },
    /// Two attributes have the same name.
    #[error("two attributes are called {name:?}; names must differ")]
    SameName {
        /// The name.
        name: String,
    },
    /// The mesh has no triangles.
    #[error("the scene has no triangles")]
    Empty,
    /// The mesh has more triangles than there are primitive ids. Bit 31 is reserved, and so are the last ids.
    #[error("the scene has {found} triangles; at most {max} are supported")]
    TooMany {
        /// Number of triangles.
        found: usize,
        /// The largest number of triangles.
        max: usize,
    },
}

/// The largest number of triangles of a scene.
pub const MAX_TRIANGLES: usize = (1 << 28) - 1;

impl TriangleMesh {
    /// A mesh of vertices and triangles, all of material 0. Normals and texture coordinates may be set afterwards.
    pub fn new(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Self {
        let materials = vec![0; triangles.len()];
        Self { positions, triangles, materials, ..Self::default() }
    }

    /// The bounding box of all vertices that triangles use. All threads of rayon's pool take part.
    pub fn bounds(&self) -> Aabb {
        let around =
            |some: &[[u32; 3]]| Aabb::around(some.iter().flatten().map(|&i| self.positions[i as usize]));
        self.triangles.par_chunks(CHUNK).map(around).reduce(|| Aabb::EMPTY, Aabb::union)
    }

    /// Bytes of all attributes and indices.
    pub fn bytes(&self) -> usize {
        let Self {
            positions,
            normals,
            uvs,
            more_uvs,
            colours,
            tangents,
            attributes: named,
            triangles,
            materials,
        } = self;
        let more_uvs: usize = more_uvs.iter().map(|uvs| size_of_val(&**uvs)).sum();
        let attributes = size_of_val(&**normals) + size_of_val(&**uvs) + size_of_val(&**tangents);
        let named: usize = named.iter().map(|attribute| size_of_val(&*attribute.values)).sum();
        let attributes = attributes + more_uvs + size_of_val(&**colours) + named;
        size_of_val(&**positions) + attributes + size_of_val(&**triangles) + size_of_val(&**materials)
    }

    /// Positions of a triangle's corners.
    pub fn corners(&self, primitive: u32) -> [Vec3; 3] {
        // `map` is not always inlined, and shading calls this function for every hit.
        let [a, b, c] = self.triangles[primitive as usize];
        [self.positions[a as usize], self.positions[b as usize], self.positions[c as usize]]
    }

    /// The texture coordinates of a set ([`TextureRef::set`]); empty if the mesh has none.
    #[inline(always)]
    pub fn uv_set(&self, set: u32) -> &[Vec2] {
        match set.checked_sub(1) {
            None => &self.uvs,
            Some(further) => self.more_uvs.get(further as usize).map_or(&[], |uvs| uvs),
        }
    }

    /// Texture coordinates of a set at barycentric (`u`, `v`). Zero if the mesh has none.
    pub fn uv_at(&self, set: u32, primitive: u32, u: f32, v: f32) -> Vec2 {
        let uvs = self.uv_set(set);
        if uvs.is_empty() {
            return Vec2::ZERO;
        }
        let [a, b, c] = self.triangles[primitive as usize];
        let [a, b, c] = [uvs[a as usize], uvs[b as usize], uvs[c as usize]];
        a * (1.0 - u - v) + b * u + c * v
    }

    /// Colour and alpha at barycentric (`u`, `v`). White and opaque if the mesh has none.
    pub fn colour_at(&self, primitive: u32, u: f32, v: f32) -> Vec4 {
        if self.colours.is_empty() {
            return Vec4::ONE;
        }
        let [a, b, c] = self.triangles[primitive as usize].map(|vertex| self.colours[vertex as usize]);
        a * (1.0 - u - v) + b * u + c * v
    }

    /// True if any triangle has an area. Rays hit no triangle without one.
    pub fn has_area(&self) -> bool {
        (0..self.triangles.len() as u32).any(|primitive| {
            let [a, b, c] = self.corners(primitive).map(Vec3::as_dvec3);
            (b - a).cross(c - a) != DVec3::ZERO
        })
    }

    /// Checks the invariants of a mesh in a scene of so many materials: lengths, indices, and that all numbers are
    /// finite. All threads of rayon's pool take part.
    ///
    /// # Errors
    /// The first violation, with its index.
    pub fn validate(&self, materials: usize) -> Result<(), MeshError> {
        let expected = self.positions.len();
        for (attribute, found) in [
            ("normals", self.normals.len()),
            ("texture coordinates", self.uvs.len()),
            ("tangents", self.tangents.len()),
            ("colours", self.colours.len()),
        ] {
            if found != 0 && found != expected {
                return Err(MeshError::Attribute { attribute, found, expected });
            }
        }
        let expected_uvs = self.uvs.len();
        if let Some(uvs) = self.more_uvs.iter().find(|uvs| !uvs.is_empty() && uvs.len() != expected_uvs) {
            let attribute = "a further set of texture coordinates";
            return Err(MeshError::Attribute { attribute, found: uvs.len(), expected: expected_uvs });
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
        check_positions(&self.positions)?;
        check_finite("normals", &self.normals)?;
        check_finite("texture coordinates", &self.uvs)?;
        check_finite("tangents", &self.tangents)?;
        check_finite("colours", &self.colours)?;
        for uvs in &self.more_uvs {
            check_finite("a further set of texture coordinates", uvs)?;
        }
        for (place, attribute) in self.attributes.iter().enumerate() {
            attribute.check(expected)?;
            if self.attributes[..place].iter().any(|other| other.name == attribute.name) {
                return Err(MeshError::SameName { name: attribute.name.clone() });
            }
        }
        check_indices(&self.triangles, expected)?;
        if let Some(triangle) = first_outside(&self.materials, |&m| (m as usize) < materials) {
            return Err(MeshError::Material {
                triangle,
                material: self.materials[triangle],
                count: materials,
            });
        }
        Ok(())
    }
}

impl TriangleMesh {
    /// Gives all normals the length 1, but those that are not finite, which [`TriangleMesh::validate`] finds. Zeros
    /// stay.
    pub fn normalise_normals(&mut self) {
        let normalise = |normal: &mut Vec3| {
            if normal.is_finite() {
                *normal = normal.normalize_or_zero();
            }
        };
        self.normals.par_iter_mut().with_min_len(CHUNK).for_each(normalise);
    }

    /// Checks that colours are from 0 to 1.
    pub(super) fn check_colours(&self) -> Result<(), MeshError> {
        let is_inside = |colour: &Vec4| (colour.cmpge(Vec4::ZERO) & colour.cmple(Vec4::ONE)).all();
        let Some(vertex) = first_outside(&self.colours, is_inside) else { return Ok(()) };
        let channels = self.colours[vertex].to_array();
        let value = channels.into_iter().find(|channel| !(0.0..=1.0).contains(channel)).unwrap_or(f32::NAN);
        Err(MeshError::Colour { vertex, value })
    }
}

/// Elements that a thread checks at a time.
const CHUNK: usize = 1 << 14;

/// The index of the first element that fails a test. All threads of rayon's pool search.
pub(super) fn first_outside<T: Sync>(elements: &[T], is_inside: impl Fn(&T) -> bool + Sync) -> Option<usize> {
    // Folding instead of stopping early lets the compiler use vectors.
    let is_sound = |chunk: &[T]| chunk.iter().fold(true, |sound, element| sound & is_inside(element));
    if elements.par_chunks(CHUNK).all(is_sound) {
        return None;
    }
    elements.iter().position(|element| !is_inside(element))
}

/// Checks that coordinates are finite and at most [`MAX_COORDINATE`].
pub(super) fn check_positions(positions: &[Vec3]) -> Result<(), MeshError> {
    // The comparison fails for NaN, too.
    let is_inside = |p: &Vec3| p.abs().cmple(Vec3::splat(MAX_COORDINATE)).all();
    match first_outside(positions, is_inside) {
        None => Ok(()),
        Some(index) => {
            let [x, y, z] = positions[index].to_array();
            Err(MeshError::Position { index, x, y, z })
        }
    }
}

/// Checks that triangles name existing vertices.
pub(super) fn check_indices(triangles: &[[u32; 3]], count: usize) -> Result<(), MeshError> {
    let is_inside = |[a, b, c]: &[u32; 3]| (*a.max(b).max(c) as usize) < count;
    match first_outside(triangles, is_inside) {
        None => Ok(()),
        Some(triangle) => {
            let [a, b, c] = triangles[triangle];
            let vertex = if a as usize >= count {
                a
            } else if b as usize >= count {
                b
            } else {
                c
            };
            Err(MeshError::Vertex { triangle, vertex, count })
        }
    }
}

/// Checks that an attribute has no NaN and no infinity.
fn check_finite<const N: usize, V: Copy + Sync + Into<[f32; N]>>(
    attribute: &'static str,
    rows: &[V],
) -> Result<(), MeshError> {
    // Comparisons with NaN fail.
    let is_finite = |row: &V| (*row).into().iter().fold(true, |finite, x| finite & (x.abs() <= f32::MAX));
    match first_outside(rows, is_finite) {
        None => Ok(()),
        Some(vertex) => Err(MeshError::NotFinite { attribute, vertex }),
    }
}
