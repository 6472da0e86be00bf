//! Ray cones: their width at a hit decides which mipmap level a texture lookup reads.

use crate::lanes::{Int, Lanes, Num};

/// Cones around rays (Akenine-Möller et al. 2021, *Improved Shader and Texture Level of Detail Using Ray
/// Cones*): their width at the rays' origins and its growth along the rays.
#[derive(Clone, Copy, Debug)]
pub struct Cone<L: Lanes> {
    /// Diameter at the origin.
    pub width: Num<L>,
    /// Growth of the diameter per unit of length.
    pub spread: Num<L>,
}

/// A direction sampled with density p per solid angle gets a cone of at least this spread / √p. It is a share
/// of the distance between neighbouring samples.
const SHARE: f32 = 1.0 / 8.0;

/// Shift of the eight bits that are stored of a number. They resolve a quarter of an octave.
const STEP: u32 = 21;
/// The least number stored is 2⁻⁴⁸; smaller numbers count as 0.
const LEAST: u32 = (127 - 48) << 2;

impl<L: Lanes> Cone<L> {
    /// Bits that [`Cone::pack`] returns.
    pub const BITS: u32 = 16;

    /// Cones of width and spread 0.
    #[inline(always)]
    pub fn thin(l: L) -> Self {
        let zero = Num::splat(l, 0.0);
        Self { width: zero, spread: zero }
    }

    /// The cones after a distance along the rays.
    #[inline(always)]
    pub fn at(self, distance: Num<L>) -> Self {
        Self { width: self.width + self.spread * distance, ..self }
    }

    /// The cones of continuation rays in directions that were sampled with density `pdf` per solid angle.
    /// Mirrored directions have an infinite density, and their spread does not grow.
    #[inline(always)]
    pub fn scattered(self, pdf: Num<L>) -> Self {
        let least = by_root(pdf) * SHARE;
        Self { spread: self.spread.max(least.clamp(0.0, 1.0)), ..self }
    }

    /// Packs the cones in sixteen bits. Width and spread are rounded down to a quarter of an octave.
    #[inline(always)]
    pub fn pack(self) -> Int<L> {
        pack(self.width) + (pack(self.spread) << 8)
    }

    /// The inverse of [`Cone::pack`], up to its rounding.
    #[inline(always)]
    pub fn unpack(bits: Int<L>) -> Self {
        Self { width: unpack(bits & 0xff), spread: unpack((bits >> 8) & 0xff) }
    }
}

/// Approximately 1 / √x for x ≥ 0, within a thirtieth, which is finer than the stored resolution.
#[inline(always)]
fn by_root<L: Lanes>(x: Num<L>) -> Num<L> {
    // Read as an integer, the bits of a float are its logarithm, up to a slight curvature.
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
