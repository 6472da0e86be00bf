//! Crossings of many rays by the half-open rule, found in streams.

use super::rays::{ExactRay, Rays};
use super::target::Target;
use crate::geom::Crossing;
use crate::stream::{Hit, Ray};
use crate::trace::cpu::TriangleSink;
use glam::{DVec3, Vec3};
use std::cell::Cell;

thread_local! {
    /// Taken by a call while it traces.
    static RAYS: Cell<Vec<Ray>> = const { Cell::new(Vec::new()) };
}

/// A triangle that a ray may cross.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    /// Index of the ray in its part.
    pub ray: usize,
    /// Primitive id in the tree.
    pub primitive: u32,
    /// Corners in the world.
    pub corners: [Vec3; 3],
}

/// A [`TriangleSink`] that is a function. What it returns saves visits if `NARROWS`.
struct Sink<F, const NARROWS: bool>(F);

impl<F: FnMut(Candidate) -> f32, const NARROWS: bool> TriangleSink for Sink<F, NARROWS> {
    fn take(&mut self, ray: usize, primitive: u32, corners: [Vec3; 3]) -> f32 {
        (self.0)(Candidate { ray, primitive, corners })
    }

    fn batch(&self) -> usize {
        if NARROWS { 1 } else { 64 }
    }
}

impl Target<'_> {
    /// Calls `take` with the triangles that each of these rays may cross. It returns the `t` beyond which the ray
    /// needs no more triangles, a negative number for none; that saves visits if `NARROWS`.
    pub(super) fn visit_candidates<const NARROWS: bool>(
        &self,
        rays: &[Ray],
        take: impl FnMut(Candidate) -> f32,
    ) {
        self.tracers.stream().visit_candidates(rays, &mut Sink::<_, NARROWS>(take));
    }

    /// Calls `take` with each crossing of consecutive rays, in no particular order, where the candidate's ray counts
    /// from
    /// `first`.
    pub(super) fn visit_crossings<const NARROWS: bool>(
        &self,
        rays: &Rays<'_>,
        first: usize,
        len: usize,
        mut take: impl FnMut(Candidate, &ExactRay, &Crossing) -> f32,
    ) {
        let mut traced = RAYS.take();
        let direct = rays.fill(first, len, self.center, &mut traced);
        if !direct {
            traced.clear();
            traced.extend((first..first + len).map(|i| rays.prepare_exact(i, self.center).ray));
        }
        self.visit_candidates::<NARROWS>(&traced, |candidate| {
            let ray = if direct {
                ExactRay::of(&traced[candidate.ray])
            } else {
                rays.prepare_exact(first + candidate.ray, self.center)
            };
            match ray.exact.crossing(candidate.corners) {
                Some(crossing) => take(candidate, &ray, &crossing),
                None => f32::INFINITY,
            }
        });
        RAYS.set(traced);
    }

    /// The first crossings of consecutive rays, with `t` in the caller's units.
    pub(super) fn first_crossings(&self, rays: &Rays<'_>, first: usize, hits: &mut [Hit]) {
        let mut nearest = vec![(f64::INFINITY, [Vec3::ZERO; 3]); hits.len()];
        self.visit_crossings::<true>(rays, first, hits.len(), |candidate, ray, crossing| {
            let Candidate { ray: index, primitive, corners } = candidate;
            let ((t, before), hit) = (&mut nearest[index], &mut hits[index]);
            if precedes(ray, (crossing.t, corners, primitive), (*t, *before, hit.primitive)) {
                (*t, *before) = (crossing.t, corners);
                *hit = ray.hit(crossing, primitive);
            }
            // Equally near ones are still of interest.
            (*t * ray.to_ray * (1.0 + 1e-6)) as f32
        });
    }
}

/// True if the first of two crossings comes first: `t`, corners and primitive id of each; a `t` of +∞ for none.
fn precedes(ray: &ExactRay, first: (f64, [Vec3; 3], u32), second: (f64, [Vec3; 3], u32)) -> bool {
    // Either has 31 bits at least.
    const ERROR: f64 = 1e-9;
    if second.0 == f64::INFINITY || first.0 * (1.0 + ERROR) < second.0 * (1.0 - ERROR) {
        return true;
    }
    if first.0 * (1.0 - ERROR) > second.0 * (1.0 + ERROR) {
        return false;
    }
    if ray.exact.crosses_first(first.1, second.1) {
        return true;
    }
    first.2 < second.2 && !ray.exact.crosses_first(second.1, first.1)
}

impl ExactRay {
    /// A crossing as a hit, with `t` in the caller's units.
    #[inline]
    pub(super) fn hit(&self, crossing: &Crossing, primitive: u32) -> Hit {
        Hit { t: (crossing.t * self.t_scale) as f32, u: crossing.u, v: crossing.v, primitive }
    }
}

/// A ray for boxes around a point, from the point in a direction that has all components.
pub(super) fn box_ray(point: DVec3, direction: DVec3) -> Ray {
    Ray::new(point.as_vec3().to_array(), direction.as_vec3().to_array())
}
