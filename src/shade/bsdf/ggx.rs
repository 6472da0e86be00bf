//! The GGX distribution of microfacets and its sampling.

use crate::lanes::{Lanes, Num, Vector, trigonometry};
use std::f32::consts::PI;

/// Microfacets distributed after Trowbridge and Reitz (GGX), isotropic, with Smith's
/// height-correlated masking.
#[derive(Clone, Copy, Debug)]
pub struct Ggx<L: Lanes> {
    /// Width of the distribution, > 0.
    pub alpha: Num<L>,
}

impl<L: Lanes> Ggx<L> {
    /// Density of facet normals at unit directions of the upper hemisphere.
    #[inline(always)]
    pub fn density(&self, normal: Vector<L>) -> Num<L> {
        let cos2 = normal.z * normal.z;
        let sin2 = normal.x * normal.x + normal.y * normal.y;
        let alpha2 = self.alpha * self.alpha;
        // cos² + sin² / α² is accurate for the narrowest lobes, where 1 − cos² is not.
        let stretch = cos2 + sin2 / alpha2;
        1.0 / (alpha2 * stretch * stretch * PI)
    }

    /// Smith's Λ for directions with cosine `z` > 0.
    #[inline(always)]
    fn lambda(&self, z: Num<L>) -> Num<L> {
        let z2 = z * z;
        let tan2 = ((1.0 - z2) / z2).clamp(0.0, f32::INFINITY);
        0.5 * ((1.0 + self.alpha * self.alpha * tan2).sqrt() - 1.0)
    }

    /// BRDF × cosine of perfectly reflecting facets, and the density of [`Ggx::sample`], for
    /// directions of the upper hemisphere whose unit half vector is `half`.
    #[inline(always)]
    pub fn evaluate(&self, wo: Vector<L>, wi: Vector<L>, half: Vector<L>) -> (Num<L>, Num<L>) {
        let common = self.density(half) / (4.0 * wo.z);
        let (near, far) = (self.lambda(wo.z), self.lambda(wi.z));
        (common / (1.0 + near + far), common / (1.0 + near))
    }

    /// What unmasked reflections from `wo` to `wi` lose to masking on the way out, 0..=1, given
    /// that they were visible from `wo`.
    #[inline(always)]
    pub fn masked(&self, wo: Vector<L>, wi: Vector<L>) -> Num<L> {
        let (near, far) = (self.lambda(wo.z), self.lambda(wi.z));
        far / (1.0 + near + far)
    }

    /// Facet normals, distributed as those visible from `wo` (Dupuy and Benyoub 2023, *Sampling
    /// Visible GGX Normals with Spherical Caps*). Mirroring `wo` at one gives `wi` with the density
    /// of [`Ggx::evaluate`]; it may lie below the surface and then counts as none.
    #[inline(always)]
    pub fn sample(&self, wo: Vector<L>, u2: [Num<L>; 2]) -> Vector<L> {
        let stretched = Vector::new(wo.x * self.alpha, wo.y * self.alpha, wo.z).normalize();
        let (sine, cosine) = trigonometry::sin_cos_turns(u2[0]);
        let z = (1.0 - u2[1]) * (1.0 + stretched.z) - stretched.z;
        let r = (1.0 - z * z).clamp(0.0, 1.0).sqrt();
        let half = Vector::new(r * cosine, r * sine, z) + stretched;
        let (zero, one) = (self.alpha.only(0), Num::splat(wo.lanes(), 1.0));
        Vector::new(half.x * self.alpha, half.y * self.alpha, half.z.max(zero))
            .normalize_or(Vector::new(zero, zero, one))
            .0
    }
}
