//! How much of a texture a lookup covers.

use crate::lanes::{Lanes, Num};

/// What rays cover of a surface, in texture coordinates.
#[derive(Clone, Copy, Debug)]
pub struct Footprint<L: Lanes> {
    /// Side of a square as large.
    pub width: Num<L>,
    /// In [0, 1): between two copies of a texture it decides, which is right on average and costs one
    /// lookup instead of two (Pharr et al. 2024, *Filtering After Shading with Stochastic Texture Filtering*).
    pub dither: Num<L>,
    /// Bumps of the surface that are smaller than this, as the alpha of a GGX distribution of their slopes.
    pub bumps: Num<L>,
}

impl<L: Lanes> Footprint<L> {
    /// Of rays without extent.
    #[inline(always)]
    pub fn point(l: L) -> Self {
        let zero = Num::splat(l, 0.0);
        Self { width: zero, dither: zero, bumps: zero }
    }

    /// A perceptual roughness together with that of the bumps: the variances of slopes add up (Toksvig 2005,
    /// *Mipmapping Normal Maps*).
    #[inline(always)]
    pub fn roughened(&self, roughness: Num<L>) -> Num<L> {
        let even = self.bumps.is_zero();
        if even == L::ALL {
            return roughness;
        }
        let alpha = roughness * roughness;
        let both = (alpha * alpha + self.bumps * self.bumps).sqrt().sqrt();
        Num::select(even, roughness, both)
    }
}
