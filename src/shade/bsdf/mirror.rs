//! Perfect reflection.

use super::{Smooth, mirrored};
use glam::Vec3;

/// Reflects `reflectance` of the light like a mirror.
#[derive(Clone, Copy, Debug)]
pub struct Mirror {
    /// Share of light reflected.
    pub reflectance: Vec3,
}

impl Mirror {
    /// See [`super::Bsdf::smooth`].
    pub fn smooth(&self, wo: Vec3) -> Smooth {
        Smooth { reflection: Some((mirrored(wo), self.reflectance)), transmission: None, eta: 1.0 }
    }
}
