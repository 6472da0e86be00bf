//! Unit vectors packed into one word: the octahedron unfolded onto a square (Cigolle et al. 2014, *A Survey
//! of Efficient Representations for Independent Unit Vectors*).

use crate::lanes::{Int, Lanes, Mask, Num, Vector};

/// Packs unit vectors into two numbers of `BITS` ≤ 16 bits each. The error of [`decode`] is at most 4.3 /
/// 2^`BITS`.
#[inline(always)]
pub fn encode<L: Lanes, const BITS: u32>(v: Vector<L>) -> Int<L> {
    let scale = 1.0 / (v.x.abs() + v.y.abs() + v.z.abs());
    let (x, y) = fold(v.x * scale, v.y * scale, v.z.below(0.0));
    quantize::<L, BITS>(x) + (quantize::<L, BITS>(y) << BITS)
}

/// Unpacks the unit vectors that [`encode`] packed.
#[inline(always)]
pub fn decode<L: Lanes, const BITS: u32>(code: Int<L>) -> Vector<L> {
    let (x, y) = (expand::<L, BITS>(code), expand::<L, BITS>(code >> BITS));
    let z = 1.0 - x.abs() - y.abs();
    let (x, y) = fold(x, y, z.below(0.0));
    Vector::new(x, y, z).normalize()
}

/// Folds the corners of the square, which are the octahedron's lower half, over its edges, in the lanes of
/// `lower`.
#[inline(always)]
fn fold<L: Lanes>(x: Num<L>, y: Num<L>, lower: Mask<L>) -> (Num<L>, Num<L>) {
    let (folded_x, folded_y) = ((1.0 - y.abs()) * x.signum(), (1.0 - x.abs()) * y.signum());
    (Num::select(lower, folded_x, x), Num::select(lower, folded_y, y))
}

#[inline(always)]
fn quantize<L: Lanes, const BITS: u32>(x: Num<L>) -> Int<L> {
    let most = ((1u32 << BITS) - 1) as f32;
    ((x * 0.5 + 0.5).clamp(0.0, 1.0) * most + 0.5).to_int()
}

#[inline(always)]
fn expand<L: Lanes, const BITS: u32>(code: Int<L>) -> Num<L> {
    let most = (1u32 << BITS) - 1;
    (code & most).to_num() * (2.0 / most as f32) - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{Sampler, warp};
    use glam::Vec3;

    fn error<const BITS: u32>(v: Vec3) -> f32 {
        (Vec3::from(decode::<_, BITS>(encode::<_, BITS>(v.into()))) - v).length()
    }

    #[test]
    fn vectors_are_unpacked_within_the_error() {
        let axes = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Y, Vec3::NEG_Z];
        let all = (0..20_000).map(|i| warp::sphere(Sampler::new(i, 0, 4).pair(0)));
        for v in all.chain(axes) {
            assert!(error::<16>(v) < 4.3 / 65536.0, "{v}");
            assert!(error::<10>(v) < 4.3 / 1024.0, "{v}");
        }
    }
}
