//! How much of a texture a lookup covers.

use crate::lanes::{Lanes, Mask, Num};

/// What rays cover of a surface, in texture coordinates.
#[derive(Clone, Copy, Debug)]
pub struct Footprint<L: Lanes> {
    /// Side of a square as large.
    pub width: Num<L>,
    /// In [0, 1): between two copies of a texture it decides, and between neighbouring texels, which is right on
    /// average and costs one lookup instead of two, or of four (Pharr et al. 2024, *Filtering After Shading with
    /// Stochastic Texture Filtering*).
    pub dither: Num<L>,
    /// Bumps of the surface that are smaller than this, as the alpha of a GGX distribution of their slopes.
    pub bumps: Num<L>,
}

impl<L: Lanes> Footprint<L> {
    /// Whether the second of two neighbours is chosen whose weights these are, across and down. By bits of `dither`
    /// that the choice of a copy hardly looks at.
    #[inline(always)]
    pub fn chosen(&self, seconds: [Num<L>; 2]) -> [Mask<L>; 2] {
        // Eight bits are left for the last.
        let (across, down) = (fraction(self.dither * 256.0), fraction(self.dither * 65_536.0) + 1.0 / 512.0);
        [across.lt(seconds[0]), down.lt(seconds[1])]
    }

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
        if even.all() {
            return roughness;
        }
        let alpha = roughness * roughness;
        let both = (alpha * alpha + self.bumps * self.bumps).sqrt().sqrt();
        Num::select(even, roughness, both)
    }
}

#[inline(always)]
fn fraction<L: Lanes>(x: Num<L>) -> Num<L> {
    x - x.floor()
}
