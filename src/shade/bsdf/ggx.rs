//! The GGX distribution of microfacets and its sampling.

use crate::lanes::{Int, Lanes, Num, Vector, trigonometry};
use std::f32::consts::PI;

/// Microfacets of Trowbridge and Reitz's distribution (GGX) with Smith's height-correlated masking.
#[derive(Clone, Copy, Debug)]
pub struct Ggx<L: Lanes> {
    /// Widths of the distribution along x and y, > 0.
    pub alpha: [Num<L>; 2],
}

impl<L: Lanes> Ggx<L> {
    /// π / density of facet normals, at unit directions of the upper hemisphere.
    #[inline(always)]
    fn sparsity(&self, normal: Vector<L>) -> Num<L> {
        let [along, across] = self.alpha;
        let (x, y) = (normal.x / along, normal.y / across);
        // This sum is accurate for the narrowest lobes; 1 − z² is not.
        let stretch = x * x + y * y + normal.z * normal.z;
        along * across * stretch * stretch
    }

    /// 1 + 2Λ, with Smith's Λ, for directions whose `z` is not 0.
    #[inline(always)]
    fn shadow(&self, w: Vector<L>) -> Num<L> {
        let (x, y) = (w.x * self.alpha[0], w.y * self.alpha[1]);
        (1.0 + (x * x + y * y) / (w.z * w.z)).sqrt()
    }

    /// BRDF × cosine of perfectly reflecting facets, and the density of mirroring `wo` at a normal from
    /// [`Ggx::sample`]. Both directions are in the upper hemisphere, and `half` is their unit half vector.
    #[inline(always)]
    pub fn evaluate(&self, wo: Vector<L>, wi: Vector<L>, half: Vector<L>) -> (Num<L>, Num<L>) {
        // D / (4 cos (1 + Λ(wo) + Λ(wi))), and the same without Λ(wi).
        let common = self.sparsity(half) * wo.z * (2.0 * PI);
        let (near, far) = (self.shadow(wo), self.shadow(wi));
        (1.0 / (common * (near + far)), 1.0 / (common * (near + 1.0)))
    }

    /// Share, 0..=1, of unmasked reflections from `wo` to `wi` that masking removes on the way out. The
    /// facets are given as visible from `wo`.
    #[inline(always)]
    pub fn masked(&self, wo: Vector<L>, wi: Vector<L>) -> Num<L> {
        let (near, far) = (self.shadow(wo), self.shadow(wi));
        (far - 1.0) / (near + far)
    }

    /// Samples normals of facets visible from `wo`, one a lane, at the Hammersley points `first` and
    /// following out of `count`. All `count` together represent the facets that `wo` sees.
    #[inline(always)]
    pub fn hammersley(&self, wo: Vector<L>, first: u32, count: u32) -> Vector<L> {
        let i = Int::iota(wo.lanes()) + first;
        let u = (i.to_num() + 0.5) * (1.0 / count as f32);
        let v = (i.reverse_bits() >> 8).to_num() * (1.0 / (1 << 24) as f32);
        self.sample(wo, [u, v])
    }

    /// Share of the facets visible from a direction of either hemisphere: Smith's G₁.
    #[inline(always)]
    pub fn g1(&self, w: Vector<L>) -> Num<L> {
        2.0 / (self.shadow(w) + 1.0)
    }

    /// Density of [`Ggx::sample`] for unit normals that `wo` is above.
    #[inline(always)]
    pub fn visible(&self, wo: Vector<L>, normal: Vector<L>) -> Num<L> {
        wo.dot(normal) * self.g1(wo) / (self.sparsity(normal) * wo.z * PI)
    }

    /// Samples the normals of facets visible from `wo` (Dupuy and Benyoub 2023, *Sampling Visible GGX Normals
    /// with Spherical Caps*). Mirroring `wo` at a normal gives `wi` with the density of [`Ggx::evaluate`]. A
    /// `wi` below the surface is not a sample.
    #[inline(always)]
    pub fn sample(&self, wo: Vector<L>, u2: [Num<L>; 2]) -> Vector<L> {
        let [along, across] = self.alpha;
        let stretched = Vector::new(wo.x * along, wo.y * across, wo.z).normalize();
        let (sine, cosine) = trigonometry::sin_cos_turns(u2[0]);
        let z = (1.0 - u2[1]) * (1.0 + stretched.z) - stretched.z;
        let r = (1.0 - z * z).clamp(0.0, 1.0).sqrt();
        let half = Vector::new(r * cosine, r * sine, z) + stretched;
        let (zero, one) = (Num::zero(along.lanes()), Num::splat(wo.lanes(), 1.0));
        Vector::new(half.x * along, half.y * across, half.z.max(zero))
            .normalize_or(Vector::new(zero, zero, one))
            .0
    }
}
