//! How wide rays are: what decides which copy of a texture they look up.

use crate::lanes::{Int, Lanes, Num};

/// Cones around rays (Akenine-Möller et al. 2021, *Improved Shader and Texture Level of Detail Using Ray
/// Cones*): how wide they are where the rays begin, and by how much they widen for each unit of length.
#[derive(Clone, Copy, Debug)]
pub struct Cone<L: Lanes> {
    /// Diameter at the origin.
    pub width: Num<L>,
    /// Diameter gained for each unit of length.
    pub spread: Num<L>,
}

/// Of a direction that was sampled with a density per solid angle, by how much its cone widens at least, times
/// the root of the density. A share of the directions: those between neighbouring samples.
const SHARE: f32 = 1.0 / 8.0;

/// Bits of a number that are stored, and where they lie: eight with a quarter of an octave's resolution.
const STEP: u32 = 21;
/// The least number stored: 2⁻⁴⁸; what is below counts as 0.
const LEAST: u32 = (127 - 48) << 2;

impl<L: Lanes> Cone<L> {
    /// Bits of [`Cone::pack`].
    pub const BITS: u32 = 16;

    /// Rays without extent.
    #[inline(always)]
    pub fn thin(l: L) -> Self {
        let zero = Num::splat(l, 0.0);
        Self { width: zero, spread: zero }
    }

    /// After a distance.
    #[inline(always)]
    pub fn at(self, distance: Num<L>) -> Self {
        Self { width: self.width + self.spread * distance, ..self }
    }

    /// Onwards in directions that were sampled with a density per solid angle; mirrored ones have an infinite
    /// density and widen no faster than before.
    #[inline(always)]
    pub fn scattered(self, pdf: Num<L>) -> Self {
        let least = by_root(pdf) * SHARE;
        Self { spread: self.spread.max(least.clamp(0.0, 1.0)), ..self }
    }

    /// In sixteen bits: to a quarter of an octave, rounded down.
    #[inline(always)]
    pub fn pack(self) -> Int<L> {
        pack(self.width) + (pack(self.spread) << 8)
    }

    /// What [`Cone::pack`] made bits of.
    #[inline(always)]
    pub fn unpack(bits: Int<L>) -> Self {
        Self { width: unpack(bits & 0xff), spread: unpack((bits >> 8) & 0xff) }
    }
}

/// About one over the square root of numbers ≥ 0, to a thirtieth: finer than what is stored distinguishes.
#[inline(always)]
fn by_root<L: Lanes>(x: Num<L>) -> Num<L> {
    // The bits of a number, read as a whole number, are its logarithm but for a slight bend.
    const MIDDLE: u32 = 0x5f37_59df;
    let half = x.to_bits() >> 1;
    ((half ^ u32::MAX) + (MIDDLE + 1)).to_num_bits()
}

#[inline(always)]
fn pack<L: Lanes>(x: Num<L>) -> Int<L> {
    let bits = x.clamp(0.0, f32::MAX).to_bits() >> STEP;
    let code = (bits + LEAST.wrapping_neg()).at_most(255);
    Int::select(bits.below(LEAST), Int::splat(x.lanes(), 0), code)
}

#[inline(always)]
fn unpack<L: Lanes>(code: Int<L>) -> Num<L> {
    ((code + LEAST) << STEP).to_num_bits().only(!code.is(0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cones_are_stored_to_a_quarter_of_an_octave() {
        let through = |width: f32, spread: f32| {
            let cone = Cone { width: Num::from(width), spread: Num::from(spread) };
            let cone = Cone::unpack(cone.pack());
            (cone.width.get(), cone.spread.get())
        };
        for i in -180..60 {
            let x = libm::exp2f(i as f32 * 0.25 + 0.01);
            let (width, spread) = through(x, 1.0 / x);
            assert!(width <= x && width > x * 0.79, "{x} became {width}");
            assert!(i > 0 || spread <= 1.0 / x, "{spread}");
        }
        assert_eq!(through(0.0, 0.0), (0.0, 0.0));
        assert_eq!(through(-1.0, f32::NAN), (0.0, 0.0));
        assert!(through(1e30, f32::INFINITY).0 > 5e4, "the widest is as good as any");
    }

    #[test]
    fn mirrors_do_not_widen_cones_and_matte_surfaces_do() {
        let cone = Cone { width: Num::from(0.1), spread: Num::from(0.01) };
        assert!((cone.at(Num::from(2.0)).width.get() - 0.12).abs() < 1e-6);
        assert_eq!(cone.scattered(Num::from(f32::INFINITY)).spread.get(), 0.01);
        assert!(cone.scattered(Num::from(0.3)).spread.get() > 0.2);
    }
}
