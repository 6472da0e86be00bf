//! Absorbing media inside closed bodies.

use glam::Vec3;
use serde::{Deserialize, Serialize};

/// A homogeneous medium that absorbs light and does not scatter it. After a distance `t` the share exp(−`absorption`
/// · t) of the light remains (Beer and Lambert).
///
/// A body's medium belongs to the material of its surface. A ray that meets the surface from inside has travelled
/// through that medium. If bodies overlap or contain each other, the surface at the ray's end determines the medium.
/// Light that travels inwards from a glass to a body inside it is therefore not absorbed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Medium {
    /// Absorption coefficient per unit of distance for each channel, ≥ 0.
    pub absorption: Vec3,
}

impl Medium {
    /// The medium in which white light becomes `colour` after `distance`: `attenuationColor` and
    /// `attenuationDistance` of KHR_materials_volume. `None` if nothing is absorbed.
    pub fn tinting(colour: Vec3, distance: f32) -> Option<Self> {
        // Absorption is limited to a factor of e³⁰.
        let absorption = colour.map(|c| -libm::logf(c.clamp(1e-13, 1.0)) / distance).min(Vec3::splat(1e30));
        (absorption.max_element() > 0.0).then_some(Self { absorption })
    }
}
