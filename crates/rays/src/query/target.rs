//! Queries that meshes and worlds have in common.

use super::columns::{ColumnWriter, HitColumns};
use super::points::{NearestColumns, Points};
use super::rays::{ExactRay, PreparedRay, Rays, Rule};
use super::shares::in_parts;
use super::tree_tracers::{SHARE_RAYS, TreeTracers};
use super::world::WorldHit;
use crate::geom::Expansion;
use crate::stream::{Hit, MISS, Ray};
use crate::trace::cpu::visit_triangles;
use glam::DVec3;
use rayon::prelude::*;
use std::cell::Cell;
use std::collections::TryReserveError;
use std::ops::ControlFlow;

thread_local! {
    /// Rays and hits of a share.
    static BUFFERS: Cell<(Vec<Ray>, Vec<Hit>)> = const { Cell::new((Vec::new(), Vec::new())) };
}

/// The most rays whose hits one thread lists at a time.
const LISTED_AT_ONCE: usize = 4096;

/// What is asked: a tree, and what its primitive ids mean.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    pub(super) tracers: &'a TreeTracers,
    /// The first primitive id of each instance of a world, and the number of all.
    pub(super) firsts: Option<&'a [u32]>,
    /// Subtracted from the caller's coordinates.
    pub(super) center: DVec3,
}

/// All hits of many rays: those of one ray after those of the ray before, nearest first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HitLists {
    /// For each ray the index of its first hit, and the number of all hits: one more than there are rays.
    pub offsets: Vec<usize>,
    /// The hits. Those of a ray at one `t` ascend by instance, then by primitive.
    pub hits: Vec<WorldHit>,
}

impl HitLists {
    /// The hits of a ray, nearest first.
    ///
    /// # Panics
    /// If there is no such ray.
    pub fn of(&self, ray: usize) -> &[WorldHit] {
        &self.hits[self.offsets[ray]..self.offsets[ray + 1]]
    }
}

/// Ray queries of meshes and worlds, on the current rayon pool. Answers do not depend on its threads.
///
/// A call of up to 1024 rays stays on the calling thread.
pub trait RayQueries {
    /// What is asked.
    #[doc(hidden)]
    fn target(&self) -> Target<'_>;

    /// The first hit of every ray, as columns. Of equally near hits [`Rule::Closed`] takes the one of the first
    /// instance, and there the lowest primitive id; [`Rule::HalfOpen`] takes the one that a ray moved by an infinitesimal
    /// amount hits first, so that its side is right at silhouettes, too.
    ///
    /// **A ray that touches a mesh may have a first hit by the closed rule and a count of 0 by the half-open one.**
    ///
    /// # Panics
    /// If a column has not one row per ray.
    fn cast(&self, rays: &Rays<'_>, rule: Rule, columns: &mut HitColumns<'_>) {
        self.target().cast(rays, rule, columns);
    }

    /// For each ray, true if it hits anything. Faster than [`RayQueries::cast`].
    ///
    /// # Panics
    /// If there is not one answer per ray.
    fn cast_occluded(&self, rays: &Rays<'_>, rule: Rule, occluded: &mut [bool]) {
        self.target().cast_occluded(rays, rule, occluded);
    }

    /// The number of hits of every ray.
    ///
    /// ```
    /// use raystream_rays::query::{Mesh, Ray, RayQueries, Rule};
    ///
    /// // A ray through the edge that two triangles share.
    /// let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    /// let mesh = Mesh::build(&corners, &[[0, 1, 2], [0, 2, 3]])?;
    /// let ray = [Ray::new([0.5, 0.5, 1.0], [0.0, 0.0, -1.0])];
    /// let mut count = [0];
    /// mesh.count_hits(&(&ray).into(), Rule::HalfOpen, &mut count);
    /// assert_eq!(count, [1]);
    /// mesh.count_hits(&(&ray).into(), Rule::Closed, &mut count);
    /// assert_eq!(count, [2]);
    /// # Ok::<(), raystream_rays::query::GeometryError>(())
    /// ```
    ///
    /// # Panics
    /// If there is not one number per ray.
    fn count_hits(&self, rays: &Rays<'_>, rule: Rule, counts: &mut [u32]) {
        self.target().count_hits(rays, rule, counts);
    }

    /// For each ray, true if it has at least `count` hits. Stops there.
    ///
    /// # Panics
    /// If there is not one answer per ray.
    fn at_least(&self, count: u32, rays: &Rays<'_>, rule: Rule, answers: &mut [bool]) {
        self.target().at_least(count, rays, rule, answers);
    }

    /// The sum of a number of each triangle over all hits of every ray: the exact sum, rounded once. A world has the
    /// numbers of one instance after the other.
    ///
    /// # Panics
    /// If there is not one number for each triangle, or one sum per ray.
    fn sum_along(&self, of_triangles: &[f32], rays: &Rays<'_>, rule: Rule, sums: &mut [f32]) {
        self.target().sum_along(of_triangles, rays, rule, sums);
    }

    /// The first `most` hits of every ray, nearest first; `usize::MAX` for all.
    ///
    /// # Errors
    /// If there is not enough memory for them.
    fn list_hits(&self, rays: &Rays<'_>, rule: Rule, most: usize) -> Result<HitLists, TryReserveError> {
        self.target().list_hits(rays, rule, most)
    }

    /// The point nearest to every point, at most `max_distance` away, which may be +∞; of equally near ones the one of the
    /// first instance, and there the lowest primitive id. As [`super::Mesh::nearest_point`], for many points.
    ///
    /// # Panics
    /// If a column has not one row per point.
    fn nearest_points(&self, points: &Points<'_>, max_distance: f32, columns: &mut NearestColumns<'_>) {
        self.target().nearest_points(points, max_distance, columns);
    }

    /// Calls `visit` with the index of a ray and a hit, for all hits of all rays: in any order, on many threads at once.
    fn for_each_hit(&self, rays: &Rays<'_>, rule: Rule, visit: impl Fn(usize, &WorldHit) + Sync)
    where
        Self: Sized,
    {
        let target = self.target();
        in_parts(rays.len(), (), LISTED_AT_ONCE, |first, len, ()| {
            target.visit_hits(rays, first, len, rule, &mut |ray, hit| visit(ray, &target.world_hit(hit)));
        });
    }
}

impl Target<'_> {
    /// A hit by its primitive id in the tree.
    #[inline]
    pub(super) fn world_hit(&self, &Hit { t, u, v, primitive }: &Hit) -> WorldHit {
        if primitive == MISS {
            return WorldHit::NONE;
        }
        let Some(firsts) = self.firsts else { return WorldHit { t, u, v, instance: 0, primitive } };
        let instance = firsts.partition_point(|&first| first <= primitive) - 1;
        WorldHit { t, u, v, instance: instance as u32, primitive: primitive - firsts[instance] }
    }

    fn cast(&self, rays: &Rays<'_>, rule: Rule, columns: &mut HitColumns<'_>) {
        columns.check(rays.len());
        in_parts(rays.len(), columns.reborrow(), SHARE_RAYS, |first, len, columns| {
            let (mut buffer, mut hits) = BUFFERS.take();
            hits.clear();
            hits.resize(len, Hit::NONE);
            match rule {
                Rule::Closed => self.closest(rays, first, &mut buffer, &mut hits),
                Rule::HalfOpen => {
                    for (i, hit) in hits.iter_mut().enumerate() {
                        *hit = self.first_crossing(&rays.prepare_exact(first + i, self.center));
                    }
                }
            }
            ColumnWriter { target: *self, rays, first }.write(&hits, columns);
            BUFFERS.set((buffer, hits));
        });
    }

    /// First hits by the canonical test of consecutive rays, with `t` in the caller's units.
    fn closest(&self, rays: &Rays<'_>, first: usize, buffer: &mut Vec<Ray>, hits: &mut [Hit]) {
        if let Some(rays) = rays.as_rays(self.center) {
            let rays = &rays[first..first + hits.len()];
            if rays.iter().all(|ray| !Rays::must_scale(ray)) {
                return self.tracers.closest_here(rays, hits);
            }
        }
        buffer.clear();
        let mut scaled = false;
        buffer.extend((first..first + hits.len()).map(|i| {
            let PreparedRay { ray, t_scale } = rays.prepare(i, self.center);
            scaled |= t_scale != 1.0;
            ray
        }));
        self.tracers.closest_here(buffer, hits);
        if scaled {
            for (i, hit) in hits.iter_mut().enumerate() {
                hit.t = (f64::from(hit.t) * rays.prepare(first + i, self.center).t_scale) as f32;
            }
        }
    }

    /// The first crossing of a ray.
    fn first_crossing(&self, ray: &ExactRay) -> Hit {
        let (mut best, mut best_t, mut best_corners) = (Hit::NONE, f64::INFINITY, Default::default());
        visit_triangles(self.tracers.bvh(), &ray.ray, |triangle| {
            if let Some(crossing) = ray.exact.crossing(triangle.corners) {
                // Distances have 31 bits at least.
                let (first, last) = (crossing.t * (1.0 - 1e-9), crossing.t * (1.0 + 1e-9));
                let nearer = if best.is_miss() || last < best_t {
                    true
                } else if first > best_t {
                    false
                } else if ray.exact.crosses_first(triangle.corners, best_corners) {
                    true
                } else {
                    triangle.primitive < best.primitive
                        && !ray.exact.crosses_first(best_corners, triangle.corners)
                };
                if nearer {
                    let t = (crossing.t * ray.t_scale) as f32;
                    best = Hit { t, u: crossing.u, v: crossing.v, primitive: triangle.primitive };
                    (best_t, best_corners) = (crossing.t, triangle.corners);
                }
            }
            ControlFlow::Continue((best_t * ray.to_ray * 1.00001) as f32)
        });
        best
    }

    /// Calls `visit` with each hit of consecutive rays, in no particular order, with `t` in the caller's units.
    pub(super) fn visit_hits(
        &self,
        rays: &Rays<'_>,
        first: usize,
        len: usize,
        rule: Rule,
        visit: &mut dyn FnMut(usize, &Hit),
    ) {
        for i in first..first + len {
            self.visit_hits_of(rays, i, rule, &mut |hit| {
                visit(i, hit);
                ControlFlow::Continue(())
            });
        }
    }

    /// Calls `visit` with the hits of a ray until it ends the search.
    fn visit_hits_of(
        &self,
        rays: &Rays<'_>,
        index: usize,
        rule: Rule,
        visit: &mut dyn FnMut(&Hit) -> ControlFlow<()>,
    ) {
        if rule == Rule::Closed {
            let PreparedRay { ray, t_scale } = rays.prepare(index, self.center);
            self.tracers.single().visit_hits(&[ray], |_, hit| {
                // The tracer does not know how to stop.
                let _ = visit(&Hit { t: (f64::from(hit.t) * t_scale) as f32, ..*hit });
            });
            return;
        }
        let ExactRay { ray, exact, t_scale, .. } = rays.prepare_exact(index, self.center);
        visit_triangles(self.tracers.bvh(), &ray, |triangle| {
            if let Some(crossing) = exact.crossing(triangle.corners) {
                let t = (crossing.t * t_scale) as f32;
                let hit = Hit { t, u: crossing.u, v: crossing.v, primitive: triangle.primitive };
                if visit(&hit).is_break() {
                    return ControlFlow::Break(());
                }
            }
            ControlFlow::Continue(f32::INFINITY)
        });
    }

    fn cast_occluded(&self, rays: &Rays<'_>, rule: Rule, occluded: &mut [bool]) {
        assert_eq!(rays.len(), occluded.len(), "one answer per ray");
        if rule == Rule::HalfOpen {
            return self.at_least(1, rays, rule, occluded);
        }
        in_parts(rays.len(), occluded, SHARE_RAYS, |first, len, occluded| {
            let (mut buffer, hits) = BUFFERS.take();
            let unscaled = rays.as_rays(self.center).map(|rays| &rays[first..first + len]);
            match unscaled.filter(|rays| rays.iter().all(|ray| !Rays::must_scale(ray))) {
                Some(rays) => self.tracers.occluded_here(rays, occluded),
                None => {
                    buffer.clear();
                    buffer.extend((first..first + len).map(|i| rays.prepare(i, self.center).ray));
                    self.tracers.occluded_here(&buffer, occluded);
                }
            }
            BUFFERS.set((buffer, hits));
        });
    }

    fn count_hits(&self, rays: &Rays<'_>, rule: Rule, counts: &mut [u32]) {
        assert_eq!(rays.len(), counts.len(), "one number per ray");
        in_parts(rays.len(), counts, LISTED_AT_ONCE, |first, len, counts| {
            counts.fill(0);
            self.visit_hits(rays, first, len, rule, &mut |ray, _| counts[ray - first] += 1);
        });
    }

    fn at_least(&self, count: u32, rays: &Rays<'_>, rule: Rule, answers: &mut [bool]) {
        assert_eq!(rays.len(), answers.len(), "one answer per ray");
        in_parts(rays.len(), answers, LISTED_AT_ONCE, |first, _, answers| {
            for (i, answer) in answers.iter_mut().enumerate() {
                let mut found = 0;
                if count > 0 {
                    self.visit_hits_of(rays, first + i, rule, &mut |_| {
                        found += 1;
                        if found < count { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
                    });
                }
                *answer = found >= count;
            }
        });
    }

    fn sum_along(&self, of_triangles: &[f32], rays: &Rays<'_>, rule: Rule, sums: &mut [f32]) {
        assert_eq!(rays.len(), sums.len(), "one sum per ray");
        assert_eq!(of_triangles.len(), self.tracers.bvh().len(), "one number per triangle");
        in_parts(rays.len(), sums, LISTED_AT_ONCE, |first, _, sums| {
            for (i, total) in sums.iter_mut().enumerate() {
                let mut sum = Expansion::zero();
                let mut special = 0.0;
                self.visit_hits_of(rays, first + i, rule, &mut |hit| {
                    let number = of_triangles[hit.primitive as usize];
                    if number.is_finite() {
                        sum.add(number.into());
                    } else {
                        special += number;
                    }
                    ControlFlow::Continue(())
                });
                *total = if special == 0.0 { sum.to_f32() } else { special };
            }
        });
    }

    fn list_hits(&self, rays: &Rays<'_>, rule: Rule, most: usize) -> Result<HitLists, TryReserveError> {
        let count = rays.len();
        let starts: Vec<usize> = (0..count).step_by(LISTED_AT_ONCE).collect();
        let list =
            |&first: &usize| self.list_part(rays, first, LISTED_AT_ONCE.min(count - first), rule, most);
        let parts: Vec<HitLists> = if count <= 1024 {
            starts.iter().map(list).collect::<Result<_, _>>()?
        } else {
            starts.par_iter().map(list).collect::<Result<_, _>>()?
        };
        let mut all = HitLists::default();
        all.hits.try_reserve_exact(parts.iter().map(|part| part.hits.len()).sum())?;
        all.offsets.try_reserve_exact(count + 1)?;
        all.offsets.push(0);
        for part in parts {
            let before = all.hits.len();
            all.offsets.extend(part.offsets.into_iter().map(|end| before + end));
            all.hits.extend(part.hits);
        }
        Ok(all)
    }

    /// The hits of consecutive rays; `offsets` has the end of each ray's hits.
    fn list_part(
        &self,
        rays: &Rays<'_>,
        first: usize,
        len: usize,
        rule: Rule,
        most: usize,
    ) -> Result<HitLists, TryReserveError> {
        let mut part = HitLists { offsets: Vec::with_capacity(len), hits: Vec::new() };
        let mut hits: Vec<Hit> = Vec::new();
        for i in first..first + len {
            hits.clear();
            let mut error = None;
            self.visit_hits_of(rays, i, rule, &mut |hit| {
                if let Err(refused) = hits.try_reserve(1) {
                    error = Some(refused);
                    return ControlFlow::Break(());
                }
                hits.push(*hit);
                ControlFlow::Continue(())
            });
            if let Some(error) = error {
                return Err(error);
            }
            hits.sort_unstable_by(|a, b| a.t.total_cmp(&b.t).then(a.primitive.cmp(&b.primitive)));
            hits.truncate(most);
            part.hits.try_reserve(hits.len())?;
            part.hits.extend(hits.iter().map(|hit| self.world_hit(hit)));
            part.offsets.push(part.hits.len());
        }
        Ok(part)
    }
}
