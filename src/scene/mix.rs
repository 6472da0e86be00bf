//! A mix of two materials.

use super::Scalar;
use serde::{Deserialize, Serialize};

/// A surface that has one of two materials at each hit, chosen by a hash of the hit ([`crate::shade::material_of`]).
/// The average over many hits is the weighted mean of both.
///
/// Either part may be a mix, but no mix may contain itself. Emission, alpha and medium are those of the mix's own
/// material, because lights are found by their triangles. The parts, and parts of parts, must have the same emission,
/// alpha and medium.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mix {
    /// Indices of the two materials in [`super::Scene::materials`].
    pub of: [u32; 2],
    /// Probability of the second material, 0..=1. Its texture is looked up in the image itself, without mipmap
    /// levels.
    pub share: Scalar,
}
