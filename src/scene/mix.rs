//! Two materials in one.

use super::Scalar;

/// A surface that is one material here and another there: each hit is of one of the two, by a hash of the hit
/// ([`crate::shade::material_of`]), so what is seen on average is both, in proportion.
///
/// Either may be a mix in turn, but none may be part of itself. Where a mix is on a surface, the surface's own
/// material says what it gives off, where it is not there and what it is filled with: light sources are found by
/// their triangles. So its parts, and theirs, are to say the same of these.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mix {
    /// Indices of the two materials.
    pub of: [u32; 2],
    /// How much of the surface is the second, 0..=1. Its texture is looked up in the image itself.
    pub share: Scalar,
}
