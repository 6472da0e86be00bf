//! The size of a mesh before it is made.

use super::TriangleMesh;
use crate::memory::OutOfMemory;
use std::collections::TryReserveError;

/// Numbers of vertices and triangles, and which attributes the vertices have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct MeshSize {
    pub(crate) vertices: u64,
    pub(crate) triangles: u64,
    pub(crate) normals: bool,
    pub(crate) uvs: bool,
    pub(crate) tangents: bool,
    pub(crate) colours: bool,
    /// Sets of texture coordinates beyond the first.
    pub(crate) more_uvs: u32,
    /// Numbers of a vertex in attributes with names of their own.
    pub(crate) numbers: u32,
}

impl MeshSize {
    /// The bytes of such a mesh.
    pub(crate) fn bytes(&self) -> u64 {
        let part = |is_there: bool, bytes: u64| if is_there { bytes } else { 0 };
        let vertex = 12 + part(self.normals, 12) + part(self.uvs, 8) + part(self.tangents, 16);
        let vertex =
            vertex + part(self.colours, 16) + 8 * u64::from(self.more_uvs) + 4 * u64::from(self.numbers);
        self.vertices.saturating_mul(vertex).saturating_add(self.triangles.saturating_mul(16))
    }

    /// Takes the memory for as many more vertices and triangles, and for the attributes that the mesh has.
    ///
    /// # Errors
    /// When the system does not give it.
    pub(crate) fn reserve(&self, mesh: &mut TriangleMesh) -> Result<(), OutOfMemory> {
        let mut reserve = || -> Result<(), TryReserveError> {
            let [vertices, triangles] =
                [self.vertices, self.triangles].map(|n| usize::try_from(n).unwrap_or(usize::MAX));
            mesh.positions.try_reserve_exact(vertices)?;
            mesh.triangles.try_reserve_exact(triangles)?;
            mesh.materials.try_reserve_exact(triangles)?;
            if self.normals {
                mesh.normals.try_reserve_exact(vertices)?;
            }
            if self.uvs {
                mesh.uvs.try_reserve_exact(vertices)?;
            }
            if self.tangents {
                mesh.tangents.try_reserve_exact(vertices)?;
            }
            if self.colours {
                mesh.colours.try_reserve_exact(vertices)?;
            }
            mesh.more_uvs.resize(mesh.more_uvs.len().max(self.more_uvs as usize), Vec::new());
            for uvs in &mut mesh.more_uvs {
                uvs.try_reserve_exact(vertices)?;
            }
            for attribute in &mut mesh.attributes {
                attribute.values.try_reserve_exact(vertices.saturating_mul(attribute.width as usize))?;
            }
            Ok(())
        };
        reserve().map_err(|_| OutOfMemory::Refused { what: self.to_string(), needed: self.bytes() })
    }
}

impl std::ops::AddAssign for MeshSize {
    fn add_assign(&mut self, other: Self) {
        self.vertices = self.vertices.saturating_add(other.vertices);
        self.triangles = self.triangles.saturating_add(other.triangles);
        self.normals |= other.normals;
        self.uvs |= other.uvs;
        self.tangents |= other.tangents;
        self.colours |= other.colours;
        self.more_uvs = self.more_uvs.max(other.more_uvs);
        self.numbers = self.numbers.max(other.numbers);
    }
}

/// As many copies.
impl std::ops::Mul<u64> for MeshSize {
    type Output = Self;

    fn mul(self, copies: u64) -> Self {
        let [vertices, triangles] = [self.vertices, self.triangles].map(|n| n.saturating_mul(copies));
        Self { vertices, triangles, ..self }
    }
}

impl std::fmt::Display for MeshSize {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "a mesh of {} vertices and {} triangles", self.vertices, self.triangles)
    }
}
