//! A smooth boundary between two transparent media.

use super::{Smooth, fresnel, mirrored};
use glam::Vec3;

/// Reflects and refracts as Fresnel's equations say.
///
/// Radiance that crosses is scaled by the square of the indices' ratio, (near / far)², since it is
/// squeezed into another solid angle; along a path that leaves the medium again the factors cancel.
#[derive(Clone, Copy, Debug)]
pub struct Dielectric {
    /// Index of the far side relative to `wo`'s side.
    pub eta: f32,
    /// Share of the crossing light that passes.
    pub transmittance: Vec3,
}

impl Dielectric {
    /// See [`super::Bsdf::smooth`].
    pub fn smooth(&self, wo: Vec3) -> Smooth {
        let (share, cosine) = fresnel::dielectric(wo.z, self.eta);
        Smooth {
            reflection: (share > 0.0).then(|| (mirrored(wo), Vec3::splat(share))),
            transmission: (share < 1.0).then(|| {
                let wi = Vec3::new(-wo.x / self.eta, -wo.y / self.eta, -cosine).normalize();
                (wi, self.transmittance * ((1.0 - share) / (self.eta * self.eta)))
            }),
            eta: self.eta,
        }
    }
}
