//! What surrounds the scene.

use glam::Vec3;

/// Radiance that arrives from infinitely far away.
#[derive(Clone, Debug)]
pub enum Environment {
    /// The same from everywhere.
    Constant(Vec3),
    /// From an equirectangular image.
    Map(EnvironmentMap),
}

impl Default for Environment {
    fn default() -> Self {
        Self::Constant(Vec3::ZERO)
    }
}

/// An equirectangular image: row 0 looks up (+y), the middle column looks along −z when the rotation
/// is 0, columns go to the right (towards +x from there).
#[derive(Clone, Debug)]
pub struct EnvironmentMap {
    /// Columns, ≥ 1.
    pub width: u32,
    /// Rows, ≥ 1.
    pub height: u32,
    /// Linear radiance, finite and ≥ 0; `width × height` of them.
    pub texels: std::sync::Arc<[[f32; 3]]>,
    /// Turns the image around +y, degrees; positive moves what is ahead (−z) to the left (−x).
    pub rotation_degrees: f32,
}
