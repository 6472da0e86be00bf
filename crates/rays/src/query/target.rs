//! Queries that meshes and worlds have in common.

use super::columns::{ColumnWriter, HitColumns};
use super::instance_starts::InstanceStarts;
use super::lists::{HitListColumns, HitLists};
use super::points::{NearestColumns, Points};
use super::rays::{PreparedRay, Rays, Rule};
use super::shares::in_parts;
use super::tree_tracers::{SHARE_RAYS, TreeTracers};
use super::world::WorldHit;
use crate::geom::Expansion;
use crate::stream::{Hit, MISS, Ray};
use glam::DVec3;
use std::cell::Cell;
use std::collections::TryReserveError;

thread_local! {
    /// Rays and hits of a share.
    static BUFFERS: Cell<(Vec<Ray>, Vec<Hit>)> = const { Cell::new((Vec::new(), Vec::new())) };
}

/// The most rays whose exact sums one thread keeps at a time.
const SUMMED_AT_ONCE: usize = 4096;

/// The tree that is asked, and what its primitive ids mean.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    pub(super) tracers: &'a TreeTracers,
    /// The primitive ids of a world's instances; `None` for a mesh.
    pub(super) starts: Option<&'a InstanceStarts>,
    /// Subtracted from the caller's coordinates.
    pub(super) center: DVec3,
}

/// Ray queries of meshes and worlds, on the current rayon pool. Answers do not depend on its threads.
///
/// A call of up to 1024 rays stays on the calling thread.
pub trait RayQueries {
    /// The tree that is asked.
    #[doc(hidden)]
    fn target(&self) -> Target<'_>;

    /// The first hit of every ray, as columns. Of equally near hits [`Rule::Closed`] takes the one of the first
    /// instance, and there the lowest primitive id; [`Rule::HalfOpen`] takes the one that a ray moved by an
    /// infinitesimal amount hits first, so that its side is right at silhouettes, too.
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

    /// The sum of a number of each triangle over all hits of every ray: the exact sum, rounded once. `of_instances` has
    /// for each instance a number for each of its triangles, none for instances that cannot be hit; one for a mesh.
    ///
    /// # Panics
    /// If there is not one number for each triangle that is hit, or one sum per ray.
    fn sum_along(&self, of_instances: &[&[f32]], rays: &Rays<'_>, rule: Rule, sums: &mut [f32]) {
        self.target().sum_along(of_instances, rays, rule, sums);
    }

    /// The first `most` hits of every ray, nearest first; `usize::MAX` for all.
    ///
    /// # Errors
    /// If there is not enough memory for them.
    fn list_hits(&self, rays: &Rays<'_>, rule: Rule, most: usize) -> Result<HitLists, TryReserveError> {
        self.target().list_hits(rays, rule, most)
    }

    /// Appends the first `most` hits of every ray to columns, nearest first; `usize::MAX` for all. Faster than
    /// [`RayQueries::list_hits`] where not all columns are asked for.
    ///
    /// # Errors
    /// If there is not enough memory for them; the columns have then no meaning.
    fn append_hits(
        &self,
        rays: &Rays<'_>,
        rule: Rule,
        most: usize,
        columns: &mut HitListColumns,
    ) -> Result<(), TryReserveError> {
        self.target().append_hits(rays, rule, most, columns)
    }

    /// Makes room in empty columns for the first `most` hits of every ray, by counting those of one ray in 256. Calls
    /// of [`RayQueries::append_hits`] for parts of the rays then copy nothing that is in the columns. Nothing happens
    /// if there is not enough memory, or if there are few rays.
    fn expect_hits(&self, rays: &Rays<'_>, rule: Rule, most: usize, columns: &mut HitListColumns) {
        self.target().expect_hits(rays, rule, most, columns);
    }

    /// The point nearest to every point, at most `max_distance` away, which may be +∞; of equally near ones the one of
    /// the first instance, and there the lowest primitive id. As [`super::Mesh::nearest_point`], for many points.
    ///
    /// # Panics
    /// If a column has not one row per point.
    fn nearest_points(&self, points: &Points<'_>, max_distance: f32, columns: &mut NearestColumns<'_>) {
        self.target().nearest_points(points, max_distance, columns);
    }

    /// Calls `visit` with the index of a ray and a hit, for all hits of all rays: in any order, on many threads at
    /// once.
    fn for_each_hit(&self, rays: &Rays<'_>, rule: Rule, visit: impl Fn(usize, &WorldHit) + Sync)
    where
        Self: Sized,
    {
        let target = self.target();
        in_parts(rays.len(), (), SHARE_RAYS, |first, len, ()| {
            target.visit_hits(rays, first, len, rule, &mut |ray, hit| {
                visit(first + ray, &target.world_hit(hit));
                true
            });
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
        let Some(starts) = self.starts else { return WorldHit { t, u, v, instance: 0, primitive } };
        let (first, instance) = starts.owner(primitive);
        WorldHit { t, u, v, instance, primitive: primitive - first }
    }

    /// A number of the triangle that is hit.
    #[inline]
    pub(super) fn number_of(&self, hit: &Hit, of_instances: &[&[f32]]) -> f32 {
        let WorldHit { instance, primitive, .. } = self.world_hit(hit);
        of_instances[instance as usize][primitive as usize]
    }

    fn cast(&self, rays: &Rays<'_>, rule: Rule, columns: &mut HitColumns<'_>) {
        columns.check(rays.len());
        in_parts(rays.len(), columns.reborrow(), SHARE_RAYS, |first, len, columns| {
            let (mut buffer, mut hits) = BUFFERS.take();
            // Those of an earlier call are overwritten.
            hits.resize(len, Hit::NONE);
            match rule {
                Rule::Closed => self.closest(rays, first, &mut buffer, &mut hits),
                Rule::HalfOpen => {
                    hits.fill(Hit::NONE);
                    self.first_crossings(rays, first, &mut hits);
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
        } else if rays.fill(first, hits.len(), self.center, buffer) {
            return self.tracers.closest_here(buffer, hits);
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

    /// Calls `visit` with each hit of consecutive rays, in no particular order, with `t` in the caller's units and the
    /// index of the ray counted from `first`. It returns false where the ray needs no more.
    pub(super) fn visit_hits(
        &self,
        rays: &Rays<'_>,
        first: usize,
        len: usize,
        rule: Rule,
        visit: &mut dyn FnMut(usize, &Hit) -> bool,
    ) {
        match rule {
            Rule::HalfOpen => self.list_crossings(rays, first, len, |ray, hit| visit(ray as usize, hit)),
            Rule::Closed => {
                for i in 0..len {
                    let PreparedRay { ray, t_scale } = rays.prepare(first + i, self.center);
                    self.tracers.single().visit_hits(&[ray], |_, hit| {
                        visit(i, &Hit { t: (f64::from(hit.t) * t_scale) as f32, ..*hit });
                    });
                }
            }
        }
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
                None if rays.fill(first, len, self.center, &mut buffer) => {
                    self.tracers.occluded_here(&buffer, occluded);
                }
                None => {
                    buffer.clear();
                    buffer.extend((first..first + len).map(|i| rays.prepare(i, self.center).ray));
                    self.tracers.occluded_here(&buffer, occluded);
                }
            }
            BUFFERS.set((buffer, hits));
        });
    }

    pub(super) fn count_hits(&self, rays: &Rays<'_>, rule: Rule, counts: &mut [u32]) {
        assert_eq!(rays.len(), counts.len(), "one number per ray");
        in_parts(rays.len(), counts, SHARE_RAYS, |first, len, counts| {
            counts.fill(0);
            if rule == Rule::HalfOpen {
                return self.count_crossings(rays, first, u32::MAX, counts);
            }
            self.visit_hits(rays, first, len, rule, &mut |ray, _| {
                counts[ray] += 1;
                true
            });
        });
    }

    fn at_least(&self, count: u32, rays: &Rays<'_>, rule: Rule, answers: &mut [bool]) {
        assert_eq!(rays.len(), answers.len(), "one answer per ray");
        if count == 0 {
            return answers.fill(true);
        }
        in_parts(rays.len(), answers, SHARE_RAYS, |first, len, answers| {
            if rule == Rule::HalfOpen {
                let mut counts = vec![0; len];
                self.count_crossings(rays, first, count, &mut counts);
                return answers.iter_mut().zip(counts).for_each(|(answer, found)| *answer = found >= count);
            }
            answers.fill(false);
            let mut counts = vec![0; if count > 1 { len } else { 0 }];
            self.visit_hits(rays, first, len, rule, &mut |ray, _| {
                if count > 1 {
                    counts[ray] += 1;
                    answers[ray] = counts[ray] >= count;
                } else {
                    answers[ray] = true;
                }
                !answers[ray]
            });
        });
    }

    fn sum_along(&self, of_instances: &[&[f32]], rays: &Rays<'_>, rule: Rule, sums: &mut [f32]) {
        assert_eq!(rays.len(), sums.len(), "one sum per ray");
        in_parts(rays.len(), sums, SUMMED_AT_ONCE, |first, len, sums| {
            let mut exact = vec![ExactSum::default(); len];
            self.visit_hits(rays, first, len, rule, &mut |ray, hit| {
                exact[ray].add(self.number_of(hit, of_instances));
                true
            });
            sums.iter_mut().zip(exact).for_each(|(sum, exact)| *sum = exact.rounded());
        });
    }
}

/// A sum of numbers, without rounding.
#[derive(Clone, Default)]
struct ExactSum {
    finite: Expansion,
    /// The sum of those that are NaN or infinite.
    special: f32,
}

impl ExactSum {
    fn add(&mut self, number: f32) {
        if number.is_finite() {
            self.finite.add(number.into());
        } else {
            self.special += number;
        }
    }

    fn rounded(&self) -> f32 {
        if self.special == 0.0 { self.finite.to_f32() } else { self.special }
    }
}
