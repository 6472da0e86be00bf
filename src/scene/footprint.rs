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

/// A footprint may be this many times as long as wide before its length counts.
const FREE_STRETCH: f32 = 4.0;

impl<L: Lanes> Footprint<L> {
    /// The footprints of cones of diameter `width` at hits of barycentrics `hit`: squares of the same area as the cones
    /// cover, in texture coordinates. `cosine` is the cosine between ray and normal, `twice_area` twice the area of the
    /// triangles and `uvs` the texture coordinates of their corners. At grazing angles the covered area is stretched.
    /// The stretch counts only beyond [`FREE_STRETCH`]: up to there, the samples of a pixel and the directions of a
    /// bounce are spread along it.
    #[inline(always)]
    pub(crate) fn of_cone(
        width: Num<L>,
        cosine: Num<L>,
        twice_area: Num<L>,
        [a, b, c]: &[[Num<L>; 2]; 3],
        hit: [Num<L>; 2],
    ) -> Self {
        let image = ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs();
        let stretch = (1.0 / (cosine.abs() * FREE_STRETCH)).clamp(1.0, f32::MAX);
        let share = image / twice_area * stretch;
        Self::of_width(width * share.sqrt(), hit)
    }

    /// The footprints of squares of this side at hits of barycentrics `hit`.
    #[inline(always)]
    pub(crate) fn of_width(width: Num<L>, hit: [Num<L>; 2]) -> Self {
        // A hash of the hit, so that each hit has its own number, the same on all units and thread counts.
        let bits = (hit[0].to_bits() * 0x9e37_79b9) ^ (hit[1].to_bits() * 0x85eb_ca6b);
        let bits = (bits ^ (bits >> 15)) * 0x7feb_352d;
        let dither = ((bits ^ (bits >> 16)) >> 8).to_num() * (1.0 / (1 << 24) as f32);
        Self { width, dither, ..Self::point(width.lanes()) }
    }

    /// True to choose the second of two neighbours, across and down. `seconds` are the weights of the second
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
