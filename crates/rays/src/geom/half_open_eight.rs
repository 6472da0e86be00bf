//! The half-open test of eight rays and triangles at a time: what `f64` is certain of, to the bit as
//! [`super::HalfOpenRay::crossing`] has it.

use super::half_open::{Determinants, LARGEST_ERROR};
use glam::DVec3;

/// Number of pairs.
const EIGHT: usize = 8;

/// Eight rays, each with a triangle, in columns: a number of each pair.
#[derive(Clone, Copy, Debug, Default)]
pub struct EightPairs {
    pub origins: [[f32; EIGHT]; 3],
    pub directions: [[f32; EIGHT]; 3],
    /// As `[corner][axis]`.
    pub corners: [[[f32; EIGHT]; 3]; 3],
    /// Where the interval begins in which crossings count. It does not belong to it.
    pub t_min: [f32; EIGHT],
    /// Where it ends.
    pub t_max: [f32; EIGHT],
}

/// What is known of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The ray does not cross the triangle.
    Misses,
    /// It does.
    Crosses,
    /// The exact numbers decide: [`super::HalfOpenRay::crossing`].
    Open,
}

/// The crossings of eight pairs.
#[derive(Clone, Copy, Debug, Default)]
pub struct EightCrossings {
    /// Ray parameter of each that crosses.
    pub t: [f64; EIGHT],
    /// Barycentric weights of the second and of the third corner.
    pub u: [f32; EIGHT],
    pub v: [f32; EIGHT],
    crosses: [bool; EIGHT],
    misses: [bool; EIGHT],
}

impl EightPairs {
    /// The crossings. All pairs are computed by the same operations, without branches: several at a time, where the
    /// caller is compiled for instructions that do so.
    #[inline(always)]
    pub fn crossings(&self) -> EightCrossings {
        let mut found = EightCrossings::default();
        for pair in 0..EIGHT {
            let vector = |of: &[[f32; EIGHT]; 3]| {
                DVec3::new(f64::from(of[0][pair]), f64::from(of[1][pair]), f64::from(of[2][pair]))
            };
            let corners = [vector(&self.corners[0]), vector(&self.corners[1]), vector(&self.corners[2])];
            let of = Determinants::of(vector(&self.origins), vector(&self.directions), corners);
            let Determinants { u, v, w, volume, facing } = of;
            let positive = u.is_positive() | v.is_positive() | w.is_positive();
            let negative = u.is_negative() | v.is_negative() | w.is_negative();
            let certain = (u.is_positive() | u.is_negative())
                & (v.is_positive() | v.is_negative())
                & (w.is_positive() | w.is_negative());
            let t = volume.value / facing.value;
            let error = of.error_of(t);
            let (low, high) = (t - 2.0 * error, t + 2.0 * error);
            let (t_min, t_max) = (f64::from(self.t_min[pair]), f64::from(self.t_max[pair]));
            let t_min = if t_min > 0.0 { t_min } else { 0.0 };
            // NaN fails the comparisons.
            let precise = (error >= 0.0) & (error <= t.abs() * LARGEST_ERROR);
            let within = precise & (low > t_min) & (high < t_max);
            let beyond = (error >= 0.0) & ((high < t_min) | (low > t_max));
            let one_side = certain & !(positive & negative);
            found.t[pair] = t;
            found.u[pair] = (u.value / facing.value).clamp(0.0, 1.0) as f32;
            found.v[pair] = (v.value / facing.value).clamp(0.0, 1.0) as f32;
            found.crosses[pair] = one_side & within;
            found.misses[pair] = (positive & negative) | (one_side & !within & beyond);
        }
        found
    }
}

impl EightCrossings {
    /// What is known of a pair.
    ///
    /// # Panics
    /// If there is no such pair.
    #[inline(always)]
    pub fn verdict(&self, pair: usize) -> Verdict {
        match (self.crosses[pair], self.misses[pair]) {
            (true, _) => Verdict::Crosses,
            (_, true) => Verdict::Misses,
            _ => Verdict::Open,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{HalfOpenRay, mix};
    use glam::Vec3;

    fn set(
        pairs: &mut EightPairs,
        pair: usize,
        [origin, direction]: [Vec3; 2],
        [t_min, t_max]: [f32; 2],
        corners: &[Vec3; 3],
    ) {
        for axis in 0..3 {
            pairs.origins[axis][pair] = origin[axis];
            pairs.directions[axis][pair] = direction[axis];
            (0..3).for_each(|corner| pairs.corners[corner][axis][pair] = corners[corner][axis]);
        }
        (pairs.t_min[pair], pairs.t_max[pair]) = (t_min, t_max);
    }

    /// In [-1, 1), in steps of an eighth for some, so that rays meet edges and corners.
    fn vector(i: u32, k: u32) -> Vec3 {
        let number = |axis: u32| {
            let x = (mix(i ^ mix(k + axis)) >> 8) as f32 / (1 << 23) as f32 - 1.0;
            if i.is_multiple_of(4) { (8.0 * x).round() / 8.0 } else { x }
        };
        Vec3::new(number(0), number(1), number(2))
    }

    #[test]
    fn what_is_certain_is_the_crossing_of_each_pair_to_the_bit() {
        let (mut crossed, mut missed, mut open) = (0, 0, 0);
        for block in 0..4000 {
            let mut pairs = EightPairs::default();
            let mut rays = Vec::new();
            for pair in 0..EIGHT {
                let i = (block * EIGHT + pair) as u32;
                let corners = [vector(i, 0), vector(i, 3), vector(i, 6)];
                let origin = 2.0 * vector(i, 9);
                let target = if i.is_multiple_of(3) {
                    corners[0]
                } else {
                    (corners[0] + corners[1] + corners[2]) / 3.0
                };
                let direction = if i.is_multiple_of(5) { vector(i, 12) } else { target - origin };
                let range = [[0.0, f32::INFINITY], [-1.0, 1.0], [1.0, 2.0], [0.5, 1.5]][i as usize / 7 % 4];
                set(&mut pairs, pair, [origin, direction], range, &corners);
                let [t_min, t_max] = range.map(f64::from);
                let ray = HalfOpenRay::new(origin.as_dvec3(), direction.as_dvec3(), t_min, t_max);
                rays.push(ray.crossing(corners));
            }
            let found = pairs.crossings();
            for (pair, expected) in rays.iter().enumerate() {
                match (found.verdict(pair), expected) {
                    (Verdict::Crosses, Some(crossing)) => {
                        crossed += 1;
                        assert_eq!(found.t[pair].to_bits(), crossing.t.to_bits());
                        assert_eq!(found.u[pair].to_bits(), crossing.u.to_bits());
                        assert_eq!(found.v[pair].to_bits(), crossing.v.to_bits());
                    }
                    (Verdict::Misses, None) => missed += 1,
                    (Verdict::Open, _) => open += 1,
                    (verdict, expected) => panic!("{verdict:?}, {expected:?}"),
                }
            }
        }
        assert!(crossed > 5000 && missed > 5000 && open > 500, "{crossed}, {missed}, {open}");
    }
}
