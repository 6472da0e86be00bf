//! The GGX distribution of microfacets and its sampling.

use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// Microfacets distributed after Trowbridge and Reitz (GGX), isotropic, with Smith's
/// height-correlated masking.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ggx {
    /// Width of the distribution, > 0.
    pub alpha: f32,
}

impl Ggx {
    /// Density of facet normals at a unit direction of the upper hemisphere.
    pub fn density(&self, normal: Vec3) -> f32 {
        let cos2 = normal.z * normal.z;
        let sin2 = normal.x * normal.x + normal.y * normal.y;
        let alpha2 = self.alpha * self.alpha;
        // cos² + sin² / α² is accurate for the narrowest lobes, where 1 − cos² is not.
        let stretch = cos2 + sin2 / alpha2;
        1.0 / (PI * alpha2 * stretch * stretch)
    }

    /// Smith's Λ for a direction with cosine `z` > 0.
    fn lambda(&self, z: f32) -> f32 {
        let tan2 = ((1.0 - z * z) / (z * z)).max(0.0);
        0.5 * ((1.0 + self.alpha * self.alpha * tan2).sqrt() - 1.0)
    }

    /// Share of facets visible from a direction with cosine `z` > 0.
    fn visible(&self, z: f32) -> f32 {
        1.0 / (1.0 + self.lambda(z))
    }

    /// BRDF × cosine of perfectly reflecting facets, and the density of [`Ggx::sample`], for
    /// directions of the upper hemisphere.
    pub fn evaluate(&self, wo: Vec3, wi: Vec3) -> (f32, f32) {
        let Some(half) = (wo + wi).try_normalize() else { return (0.0, 0.0) };
        let common = self.density(half) / (4.0 * wo.z);
        let (near, far) = (self.lambda(wo.z), self.lambda(wi.z));
        (common / (1.0 + near + far), common * self.visible(wo.z))
    }

    /// What an unmasked reflection from `wo` to `wi` loses to masking on the way out, 0..=1, given
    /// that it was visible from `wo`.
    pub fn masked(&self, wo: Vec3, wi: Vec3) -> f32 {
        let (near, far) = (self.lambda(wo.z), self.lambda(wi.z));
        far / (1.0 + near + far)
    }

    /// A facet normal, distributed as those visible from `wo` (Dupuy and Benyoub 2023, *Sampling
    /// Visible GGX Normals with Spherical Caps*). Mirroring `wo` at it gives `wi` with the density
    /// of [`Ggx::evaluate`]; it may lie below the surface and then counts as none.
    pub fn sample(&self, wo: Vec3, u2: [f32; 2]) -> Vec3 {
        let stretched = Vec3::new(wo.x * self.alpha, wo.y * self.alpha, wo.z).normalize();
        let phi = TAU * u2[0];
        let z = (1.0 - u2[1]) * (1.0 + stretched.z) - stretched.z;
        let r = (1.0 - z * z).max(0.0).sqrt();
        let half = Vec3::new(r * libm::cosf(phi), r * libm::sinf(phi), z) + stretched;
        Vec3::new(half.x * self.alpha, half.y * self.alpha, half.z.max(0.0))
            .try_normalize()
            .unwrap_or(Vec3::Z)
    }
}
