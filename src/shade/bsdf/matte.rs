//! Lambertian reflection.

use super::Sample;
use crate::geom::warp;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Reflects `reflectance` of the light evenly over the hemisphere of `wo`.
#[derive(Clone, Copy, Debug)]
pub struct Matte {
    /// Albedo.
    pub reflectance: Vec3,
}

impl Matte {
    /// See [`super::Bsdf::evaluate`].
    pub fn evaluate(&self, wi: Vec3) -> (Vec3, f32) {
        let pdf = warp::cosine_hemisphere_pdf(wi.z);
        (self.reflectance * (FRAC_1_PI * wi.z.max(0.0)), pdf)
    }

    /// See [`super::Bsdf::sample`].
    pub fn sample(&self, u2: [f32; 2]) -> Option<Sample> {
        let wi = warp::cosine_hemisphere(u2);
        (wi.z > 0.0).then(|| Sample::scattered(wi, self.reflectance, warp::cosine_hemisphere_pdf(wi.z)))
    }
}
