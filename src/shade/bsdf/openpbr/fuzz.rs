//! Fuzz: fibres over the whole surface.

use super::super::sheen::Sheen;
use crate::lanes::{Lanes, Num, Vector};

/// Factor of the fibres' reflection: their table is inexact, and nothing may be gained.
const KEPT: f32 = 0.95;

/// Fibres that cover a share of the surface. The specification recommends lobes that Zeltner, Burley and Chiang (2022)
/// fitted to simulations. These are not reciprocal; [`Sheen`] is, and has nearly the same albedo at another roughness.
#[derive(Clone, Copy, Debug)]
pub struct Fuzz<L: Lanes> {
    /// Covered share, 0..=1.
    weight: Num<L>,
    /// Tint of the light that the fibres reflect. What they pass is untinted.
    colour: Vector<L>,
    sheen: Sheen<L>,
}

impl<L: Lanes> Fuzz<L> {
    /// Fuzz of a weight, a colour and a roughness, each 0..=1.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn new(weight: Num<L>, colour: Vector<L>, roughness: Num<L>) -> Self {
        // Conty and Kulla's roughness at which the mean albedo is that of the recommended lobes.
        let sheen = roughness * roughness.sqrt();
        let white = Vector::grey(Num::splat(weight.lanes(), 1.0));
        Self { weight, colour, sheen: Sheen::of(white, sheen) }
    }

    /// Share that the fibres reflect towards a cosine if they are white. The rest reaches the layers below.
    #[inline(always)]
    pub fn share(&self, z: Num<L>) -> Num<L> {
        self.sheen.share(z).clamp(0.0, 1.0) * self.weight
    }

    /// Light reflected towards a direction of this share under a uniform environment of radiance 1.
    #[inline(always)]
    pub fn reflected(&self, share: Num<L>) -> Vector<L> {
        self.colour * share
    }

    /// Reflection × cosine of `wi`.
    #[inline(always)]
    pub fn evaluate(&self, wo: Vector<L>, wi: Vector<L>, half: Vector<L>) -> Vector<L> {
        let shares = [self.sheen.share(wo.z), self.sheen.share(wi.z)];
        self.sheen.evaluate(wo, wi, half, shares) * self.colour * (self.weight * KEPT)
    }
}
