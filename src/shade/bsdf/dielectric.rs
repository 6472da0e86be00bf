//! A smooth boundary between two transparent media.

use super::{Smooth, fresnel, mirrored};
use crate::lanes::{Lanes, Num, Vector};

/// Reflects and refracts by Fresnel's equations.
///
/// Radiance that crosses is multiplied by the squared ratio of the indices, (near / far)², since refraction
/// changes its solid angle. Along a path that leaves the medium again, the factors cancel.
#[derive(Clone, Copy, Debug)]
pub struct Dielectric<L: Lanes> {
    /// Index of refraction of the far side relative to `wo`'s side.
    pub eta: Num<L>,
    /// Share of the crossing light that passes.
    pub transmittance: Vector<L>,
}

impl<L: Lanes> Dielectric<L> {
    /// See [`super::Bsdf::smooth`].
    #[inline(always)]
    pub fn smooth(&self, wo: Vector<L>) -> Smooth<L> {
        let (share, cosine) = fresnel::dielectric(wo.z, self.eta);
        Smooth {
            reflected: mirrored(wo),
            reflection: Vector::grey(share),
            transmitted: fresnel::refracted(wo, self.eta, cosine),
            transmission: self.transmittance * ((1.0 - share) / (self.eta * self.eta)),
            eta: self.eta,
        }
    }
}
