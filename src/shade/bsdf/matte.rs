//! Lambertian reflection.

use super::Sample;
use crate::geom::warp::lanes as warp;
use crate::lanes::{Lanes, Mask, Num, Vector};
use std::f32::consts::FRAC_1_PI;

/// Reflects the share `reflectance` of the light uniformly over the hemisphere of `wo`.
#[derive(Clone, Copy, Debug)]
pub struct Matte<L: Lanes> {
    /// Albedo per channel.
    pub reflectance: Vector<L>,
}

impl<L: Lanes> Matte<L> {
    /// See [`super::Bsdf::evaluate`].
    #[inline(always)]
    pub fn evaluate(&self, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let pdf = warp::cosine_hemisphere_pdf(wi.z);
        (self.reflectance * (wi.z.clamp(0.0, 1.0) * FRAC_1_PI), pdf)
    }

    /// See [`super::Bsdf::sample`].
    #[inline(always)]
    pub fn sample(&self, u2: [Num<L>; 2]) -> Sample<L> {
        let wi = warp::cosine_hemisphere(u2);
        let none = Mask::splat(wi.lanes(), false);
        Sample {
            valid: wi.z.above(0.0),
            wi,
            weight: self.reflectance,
            pdf: warp::cosine_hemisphere_pdf(wi.z),
            specular: none,
            crosses: none,
            eta: Num::splat(wi.lanes(), 1.0),
        }
    }
}
