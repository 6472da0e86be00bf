//! The area of a texture that a lookup covers.

use crate::lanes::{Lanes, Mask, Num};

/// The area that a ray's cone covers on a surface, in texture coordinates.
#[derive(Clone, Copy, Debug)]
pub struct Footprint<L: Lanes> {
    /// Side of the square with the same area.
    pub width: Num<L>,
    /// A number in [0, 1) that chooses between two mipmap levels and between neighbouring texels. The choice is right
    /// on average. It costs one lookup instead of two or, between texels, four (Pharr et al. 2024, *Filtering After
    /// Shading with Stochastic Texture Filtering*).
    pub dither: Num<L>,
    /// Roughness of bumps that are smaller than the footprint, as the alpha of a GGX distribution of their slopes.
    pub bumps: Num<L>,
}

impl<L: Lanes> Footprint<L> {
    /// Whether to choose the second of two neighbours, across and down. `seconds` are the weights of the second
    /// neighbours. The choice uses bits of `dither` that hardly affect the choice of a mipmap level.
    #[inline(always)]
    pub fn chosen(&self, seconds: [Num<L>; 2]) -> [Mask<L>; 2] {
        // Eight bits remain for the second choice.
        let (across, down) = (fraction(self.dither * 256.0), fraction(self.dither * 65_536.0) + 1.0 / 512.0);
        [across.lt(seconds[0]), down.lt(seconds[1])]
    }

    /// The footprint of rays without a width.
    #[inline(always)]
    pub fn point(l: L) -> Self {
        let zero = Num::splat(l, 0.0);
        Self { width: zero, dither: zero, bumps: zero }
    }

    /// Adds the roughness of the bumps to a perceptual roughness: the variances of slopes add up (Toksvig 2005,
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
