//! What fills a body.

use glam::Vec3;

/// A medium that absorbs light and does not scatter it: of light that goes a distance `t` through it, the share
/// exp(−`absorption` · t) is left (Beer and Lambert).
///
/// A body's material says what fills it, and a ray that meets the body's surface from inside has come
/// through that. So where bodies overlap or lie within each other, the surface that is met tells the medium
/// before it: between a glass and what is in it, light that goes inwards is not absorbed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Medium {
    /// Per unit of distance, per channel, ≥ 0.
    pub absorption: Vec3,
}

impl Medium {
    /// The medium in which white light takes on `colour` after `distance` (KHR_materials_volume); `None` if
    /// it stays white.
    pub fn tinting(colour: Vec3, distance: f32) -> Option<Self> {
        // Beyond e³⁰ there is nothing left.
        let absorption = colour.map(|c| -libm::logf(c.clamp(1e-13, 1.0)) / distance).min(Vec3::splat(1e30));
        (absorption.max_element() > 0.0).then_some(Self { absorption })
    }
}
