//! Rays as callers have them: arrays of `f32` or `f64`, in any units.

use super::rows::write_rays;
use crate::geom::{HalfOpenRay, MAX_COORDINATE};
use crate::stream::Ray;
use glam::{DVec3, Vec3};

/// Interval of `t`, in lengths of the direction, in which hits count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Least `t`; a negative value counts as 0. Included by [`Rule::Closed`], excluded by [`Rule::HalfOpen`].
    pub t_min: f32,
    /// Greatest `t`, included; may be +∞.
    pub t_max: f32,
}

impl Default for Range {
    /// From 0 to infinity.
    fn default() -> Self {
        Self { t_min: 0.0, t_max: f32::INFINITY }
    }
}

/// Rule by which a ray hits a triangle at an edge or a corner.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Rule {
    /// The canonical test ([`crate::geom::CanonicalRay`]): edges and corners belong to all triangles that have them. No
    /// ray slips through, but hits cannot be counted.
    #[default]
    Closed,
    /// Exact signs, ties decided as if the ray were moved by an infinitesimal amount, the same for all triangles: a ray
    /// that crosses a surface at an edge or a corner hits it once; one that only touches it there, never or twice. Hits
    /// count if `t_min < t <= t_max`.
    HalfOpen,
}

/// Rays in arrays of the caller.
///
/// Directions are any finite vectors but zero, whose length is the unit of `t`. A ray with another direction, with a
/// coordinate that is NaN or infinite, or with an origin beyond [`MAX_COORDINATE`] hits nothing, and so does a segment
/// with such an end.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Rays<'a> {
    /// Rays with an interval each.
    Rays(&'a [Ray]),
    /// Rows of an origin and a direction.
    Rows(&'a [[f32; 6]], Range),
    /// Origins and as many directions.
    Pairs(&'a [[f32; 3]], &'a [[f32; 3]], Range),
    /// Rows of an origin and a direction.
    Rows64(&'a [[f64; 6]], Range),
    /// Origins and as many directions.
    Pairs64(&'a [[f64; 3]], &'a [[f64; 3]], Range),
    /// Segments from points to as many points, without both ends: `t` is 0 at the first, 1 at the second.
    Segments(&'a [[f32; 3]], &'a [[f32; 3]]),
    /// Segments from points to as many points, without both ends.
    Segments64(&'a [[f64; 3]], &'a [[f64; 3]]),
}

impl<'a> From<&'a [Ray]> for Rays<'a> {
    fn from(rays: &'a [Ray]) -> Self {
        Self::Rays(rays)
    }
}

impl<'a> From<&'a Vec<Ray>> for Rays<'a> {
    fn from(rays: &'a Vec<Ray>) -> Self {
        Self::Rays(rays)
    }
}

impl<'a, const N: usize> From<&'a [Ray; N]> for Rays<'a> {
    fn from(rays: &'a [Ray; N]) -> Self {
        Self::Rays(rays)
    }
}

/// A ray that is ready to be traced.
#[derive(Clone, Copy, Debug)]
pub(super) struct PreparedRay {
    /// The ray relative to the mesh's centre, its direction scaled by a power of two where it is out of range.
    pub ray: Ray,
    /// Factor from the `t` of `ray` to the caller's: a power of two.
    pub t_scale: f64,
}

/// A ray that is ready for the half-open test.
#[derive(Clone, Copy, Debug)]
pub(super) struct ExactRay {
    /// The ray that boxes are tested against.
    pub ray: Ray,
    /// The ray that triangles are tested against.
    pub exact: HalfOpenRay,
    /// Factor from the `t` of `exact` to the caller's: a power of two.
    pub t_scale: f64,
    /// Factor from the `t` of `exact` to that of `ray`: a power of two.
    pub to_ray: f64,
}

impl ExactRay {
    /// Of a ray that is traced as it is.
    #[inline]
    pub fn of(ray: &Ray) -> Self {
        let (origin, direction) = (Vec3::from_array(ray.origin), Vec3::from_array(ray.direction));
        let exact = HalfOpenRay::new(
            origin.as_dvec3(),
            direction.as_dvec3(),
            f64::from(ray.t_min),
            f64::from(ray.t_max),
        );
        Self { ray: *ray, exact, t_scale: 1.0, to_ray: 1.0 }
    }
}

/// Smallest and largest size of a component of a direction that is traced as it is.
const UNSCALED: std::ops::RangeInclusive<f64> = 1e-9..=1e9;

/// The least and the greatest `f32` in [`UNSCALED`].
const LEAST_UNSCALED: f32 = 1e-9f32.next_up();
const GREATEST_UNSCALED: f32 = 1e9;
const _: () = assert!(LEAST_UNSCALED as f64 >= 1e-9 && (1e-9f32 as f64) < 1e-9);
const _: () = assert!(GREATEST_UNSCALED as f64 == 1e9);

/// Size below which a coordinate of an `f64` ray counts as 0: products of three remain exact.
const SMALLEST: f64 = 1.0 / (1u128 << 100) as f64 / (1u128 << 100) as f64;

/// Share of an interval by which boxes are tested beyond its ends: more than rounding errors.
const MARGIN: f32 = 1e-5;

impl Rays<'_> {
    /// A direction with a component larger than the first, and none larger than the second, is traced as it is.
    pub(super) const USUAL: (f32, f32) = (1e-9, GREATEST_UNSCALED);

    /// Number of rays: the lesser one if two arrays differ.
    pub fn len(&self) -> usize {
        match self {
            Self::Rays(rays) => rays.len(),
            Self::Rows(rows, _) => rows.len(),
            Self::Rows64(rows, _) => rows.len(),
            Self::Pairs(a, b, _) | Self::Segments(a, b) => a.len().min(b.len()),
            Self::Pairs64(a, b, _) | Self::Segments64(a, b) => a.len().min(b.len()),
        }
    }

    /// True if there are no rays.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Consecutive rays.
    ///
    /// # Panics
    /// If there are no such rays.
    pub fn part(&self, range: std::ops::Range<usize>) -> Self {
        match *self {
            Self::Rays(rays) => Self::Rays(&rays[range]),
            Self::Rows(rows, limits) => Self::Rows(&rows[range], limits),
            Self::Rows64(rows, limits) => Self::Rows64(&rows[range], limits),
            Self::Pairs(a, b, limits) => Self::Pairs(&a[range.clone()], &b[range], limits),
            Self::Pairs64(a, b, limits) => Self::Pairs64(&a[range.clone()], &b[range], limits),
            Self::Segments(a, b) => Self::Segments(&a[range.clone()], &b[range]),
            Self::Segments64(a, b) => Self::Segments64(&a[range.clone()], &b[range]),
        }
    }

    /// The point of a ray at a `t`, in the caller's units. A segment is at its first point at 0 and at the second at 1.
    ///
    /// # Panics
    /// If there is no such ray.
    pub fn at(&self, index: usize, t: f64) -> DVec3 {
        let Source { from, to, is_segment, .. } = self.get(index);
        from + t * if is_segment { to - from } else { to }
    }

    /// True if this ray can hit something: see [`Rays`].
    pub fn is_traceable(&self, index: usize) -> bool {
        crate::trace::cpu::is_traceable(&self.prepare(index, DVec3::ZERO).ray)
    }

    /// True if the slice is traced as it is: it needs no centre and is an array of [`Ray`].
    pub(super) fn as_rays(&self, center: DVec3) -> Option<&[Ray]> {
        match self {
            Self::Rays(rays) if center == DVec3::ZERO => Some(rays),
            _ => None,
        }
    }

    /// True if the direction of a ray is scaled before it is traced.
    #[inline(always)]
    pub(super) fn must_scale(ray: &Ray) -> bool {
        let [x, y, z] = ray.direction;
        let largest = x.abs().max(y.abs()).max(z.abs());
        largest > 0.0 && !(LEAST_UNSCALED..=GREATEST_UNSCALED).contains(&largest)
    }

    /// Origin, direction and interval of a ray, or the ends of a segment.
    #[inline]
    fn get(&self, index: usize) -> Source {
        let ray = |row: [f64; 6], &Range { t_min, t_max }: &Range| {
            let [x, y, z, dx, dy, dz] = row;
            Source { from: DVec3::new(x, y, z), to: DVec3::new(dx, dy, dz), t_min, t_max, is_segment: false }
        };
        let segment = |from, to| Source { from, to, t_min: 0.0, t_max: 1.0, is_segment: true };
        let wide = |a: [f32; 3]| Vec3::from_array(a).as_dvec3();
        let join = |[a, b, c]: [f64; 3], [d, e, f]: [f64; 3]| [a, b, c, d, e, f];
        match self {
            Self::Rays(rays) => {
                let Ray { origin, direction, t_min, t_max } = rays[index];
                ray(join(origin.map(f64::from), direction.map(f64::from)), &Range { t_min, t_max })
            }
            Self::Rows(rows, range) => ray(rows[index].map(f64::from), range),
            Self::Pairs(from, to, range) => {
                ray(join(from[index].map(f64::from), to[index].map(f64::from)), range)
            }
            Self::Rows64(rows, range) => ray(rows[index], range),
            Self::Pairs64(from, to, range) => ray(join(from[index], to[index]), range),
            Self::Segments(from, to) => segment(wide(from[index]), wide(to[index])),
            Self::Segments64(from, to) => segment(from[index].into(), to[index].into()),
        }
    }

    /// A ray for the canonical test, relative to the mesh's centre.
    #[inline]
    pub(super) fn prepare(&self, index: usize, center: DVec3) -> PreparedRay {
        let Source { from, to, t_min, t_max, is_segment } = self.get(index);
        let from = from - center;
        let direction = match is_segment {
            true if (to - center).abs().cmple(DVec3::splat(MAX_COORDINATE.into())).all() => {
                to - center - from
            }
            // Nothing is hit.
            true => DVec3::ZERO,
            false => to,
        };
        let largest = direction.abs().max_element();
        let scale = if UNSCALED.contains(&largest) { 1.0 } else { power_of_two(largest) };
        let direction = (direction / scale).as_vec3().to_array();
        let mut ray = Ray { origin: from.as_vec3().to_array(), t_min, direction, t_max };
        if is_segment {
            // The ends are excluded.
            (ray.t_min, ray.t_max) = (f32::MIN_POSITIVE, 1.0 - f32::EPSILON / 2.0);
        }
        if scale != 1.0 {
            ray.t_min = (f64::from(ray.t_min) * scale) as f32;
            ray.t_max = (f64::from(ray.t_max) * scale) as f32;
        }
        PreparedRay { ray, t_scale: 1.0 / scale }
    }

    /// Fills `traced` with consecutive rays that are traced as they are; false if some are not `f32` rays in range, or
    /// must be moved by a centre.
    pub(super) fn fill(&self, first: usize, len: usize, center: DVec3, traced: &mut Vec<Ray>) -> bool {
        if center != DVec3::ZERO {
            return false;
        }
        match self {
            Self::Rays(rays) => {
                traced.clear();
                traced.extend_from_slice(&rays[first..first + len]);
            }
            Self::Rows(rows, range) => {
                traced.resize(len, Ray::default());
                return write_rays(&rows[first..first + len], range, traced);
            }
            Self::Pairs(origins, directions, range) => {
                let pairs = origins[first..first + len].iter().zip(&directions[first..first + len]);
                let &Range { t_min, t_max } = range;
                traced.clear();
                traced.extend(pairs.map(|(&origin, &direction)| Ray { origin, t_min, direction, t_max }));
            }
            _ => return false,
        }
        !traced.iter().any(Self::must_scale)
    }

    /// A ray for the half-open test, relative to the mesh's centre.
    #[inline]
    pub(super) fn prepare_exact(&self, index: usize, center: DVec3) -> ExactRay {
        let Source { from, to, t_min, t_max, is_segment } = self.get(index);
        let PreparedRay { mut ray, t_scale } = self.prepare(index, center);
        let scale = 1.0 / t_scale;
        let ends = [t_min, t_max].map(|t| f64::from(t) * scale);
        let (from, to) =
            (flushed(from - center), if is_segment { flushed(to - center) } else { flushed(to / scale) });
        // Boxes are tested for a ray that may differ from the exact one in its last bits.
        ray.t_min = ends[0] as f32 * (1.0 - MARGIN);
        ray.t_max = (ends[1] as f32 * (1.0 + MARGIN)).max(f32::MIN_POSITIVE);
        if is_segment {
            ExactRay { ray, exact: HalfOpenRay::segment(from, to), t_scale: 1.0, to_ray: scale }
        } else {
            let exact = HalfOpenRay::new(from, to, ends[0], ends[1]);
            ExactRay { ray, exact, t_scale, to_ray: 1.0 }
        }
    }
}

/// A ray, or a segment between two points.
struct Source {
    from: DVec3,
    /// The direction, or the other end of a segment.
    to: DVec3,
    t_min: f32,
    t_max: f32,
    is_segment: bool,
}

/// The greatest power of two that is not greater than a number; 1 for zero, NaN and infinity.
#[inline]
fn power_of_two(number: f64) -> f64 {
    if !(number > 0.0 && number < f64::INFINITY) {
        return 1.0;
    }
    if number < f64::MIN_POSITIVE {
        return f64::MIN_POSITIVE;
    }
    f64::from_bits(number.to_bits() & f64::INFINITY.to_bits())
}

/// The vector with components of 0 in place of very small ones.
#[inline]
fn flushed(vector: DVec3) -> DVec3 {
    DVec3::select(vector.abs().cmplt(DVec3::splat(SMALLEST)), DVec3::ZERO, vector)
}
