//! The environment of a scene.

use glam::Vec3;

/// Radiance from infinitely far away.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Environment {
    /// The same radiance from all directions, linear Rec. 709, finite and ≥ 0.
    Constant(Vec3),
    /// Radiance from an equirectangular image.
    Map(EnvironmentMap),
}

impl Default for Environment {
    fn default() -> Self {
        Self::Constant(Vec3::ZERO)
    }
}

/// An equirectangular image. Row 0 is up (+y). With a rotation of 0 the middle column is the direction −z, and
/// columns further right turn towards +x.
#[derive(Clone, Debug)]
pub struct EnvironmentMap {
    /// Columns, ≥ 1.
    pub width: u32,
    /// Rows, ≥ 1.
    pub height: u32,
    /// Linear Rec. 709 radiance, finite and ≥ 0: `width × height` texels, row major, first row on top.
    pub texels: std::sync::Arc<[[f32; 3]]>,
    /// Rotation of the image about +y in degrees. A positive angle moves the image's middle from −z towards −x.
    pub rotation_degrees: f32,
}
