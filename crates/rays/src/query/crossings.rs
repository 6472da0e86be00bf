//! Crossings of many rays by the half-open rule, found in streams.

use super::rays::{ExactRay, Rays};
use super::target::Target;
use crate::bvh::WIDTH;
use crate::geom::{Crossing, EightCrossings, EightPairs, Verdict};
use crate::lanes::{LaneTask, Lanes, SimdLevel};
use crate::stream::{Hit, Ray};
use crate::trace::cpu::{Candidate, CandidateColumns, MAX_BATCH, Tally, TriangleSink};
use glam::{DVec3, Vec3};
use std::cell::Cell;

thread_local! {
    /// Taken by a call while it traces.
    static RAYS: Cell<Vec<Ray>> = const { Cell::new(Vec::new()) };
}

/// A [`TriangleSink`] that is a function. What it returns saves visits if `NARROWS`.
struct Sink<F, const NARROWS: bool>(F);

impl<F: FnMut(&Candidate) -> f32, const NARROWS: bool> TriangleSink for Sink<F, NARROWS> {
    fn take(&mut self, candidate: &Candidate) -> f32 {
        (self.0)(candidate)
    }

    fn batch(&self) -> usize {
        if NARROWS { 1 } else { MAX_BATCH }
    }
}

/// Counts the crossings of rays that are traced to the bit as they are tested.
struct Counter<'a> {
    rays: &'a [Ray],
    counts: &'a mut [u32],
    enough: u32,
}

impl TriangleSink for Counter<'_> {
    fn take(&mut self, candidate: &Candidate) -> f32 {
        let count = &mut self.counts[candidate.ray];
        let crosses = ExactRay::of(&self.rays[candidate.ray]).exact.crossing(candidate.corners).is_some();
        *count += u32::from(crosses);
        if *count < self.enough { f32::INFINITY } else { -1.0 }
    }

    fn tally(&mut self) -> Option<Tally<'_>> {
        Some(Tally { counts: self.counts, enough: self.enough })
    }
}

/// Hands the crossings of rays that are traced to the bit as they are tested to a function, each with the index of its
/// ray. It returns false where no more are wanted.
struct Lister<'a, F> {
    rays: &'a [Ray],
    level: SimdLevel,
    columns: &'a mut CandidateColumns,
    list: F,
    /// False when no more are wanted.
    more: bool,
}

impl<F: FnMut(u32, &Hit) -> bool> Lister<'_, F> {
    /// The crossing of a candidate by the exact numbers.
    fn hit(&self, &Candidate { ray, primitive, corners }: &Candidate) -> Option<Hit> {
        let ray = ExactRay::of(&self.rays[ray]);
        ray.exact.crossing(corners).map(|crossing| ray.hit(&crossing, primitive))
    }

    /// The same of a candidate in the columns.
    #[cold]
    #[inline(never)]
    fn exact_hit(&self, index: usize) -> Option<Hit> {
        let columns = &self.columns;
        let corner = |k: usize| {
            let [x, y, z] = &columns.corners[k];
            Vec3::new(x[index], y[index], z[index])
        };
        let corners = [corner(0), corner(1), corner(2)];
        self.hit(&Candidate {
            ray: columns.rays[index] as usize,
            primitive: columns.primitives[index],
            corners,
        })
    }
}

impl<F: FnMut(u32, &Hit) -> bool> TriangleSink for Lister<'_, F> {
    fn take(&mut self, candidate: &Candidate) -> f32 {
        if self.more
            && let Some(hit) = self.hit(candidate)
        {
            self.more = (self.list)(candidate.ray as u32, &hit);
        }
        if self.more { f32::INFINITY } else { -1.0 }
    }

    fn columns(&mut self) -> Option<&mut CandidateColumns> {
        Some(self.columns)
    }

    fn take_columns(&mut self) {
        if self.more {
            self.level.run(Listed { lister: self });
        }
    }
}

/// [`Lister::take_columns`], eight candidates at a time.
struct Listed<'a, 'b, F> {
    lister: &'a mut Lister<'b, F>,
}

impl<F: FnMut(u32, &Hit) -> bool> LaneTask for Listed<'_, '_, F> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, _: L) {
        let lister = self.lister;
        let columns = &*lister.columns;
        let mut found = [EightCrossings::default(); MAX_BATCH / WIDTH];
        for (block, found) in found.iter_mut().enumerate().take(columns.len.div_ceil(WIDTH)) {
            *found = pairs_of(columns, WIDTH * block).crossings();
        }
        // What was stored as vectors is read as numbers only now, when it has reached the cache.
        for index in 0..columns.len {
            let (of, pair) = (&found[index / WIDTH], index % WIDTH);
            let primitive = columns.primitives[index];
            let hit = match of.verdict(pair) {
                Verdict::Misses => continue,
                Verdict::Crosses => Hit { t: of.t[pair] as f32, u: of.u[pair], v: of.v[pair], primitive },
                Verdict::Open => match lister.exact_hit(index) {
                    Some(hit) => hit,
                    None => continue,
                },
            };
            if !(lister.list)(columns.rays[index], &hit) {
                lister.more = false;
                return;
            }
        }
    }
}

/// Eight candidates in columns, from `first` on.
#[inline(always)]
fn pairs_of(columns: &CandidateColumns, first: usize) -> EightPairs {
    let [a, b, c] = &columns.corners;
    EightPairs {
        origins: eight_of(&columns.origins, first),
        directions: eight_of(&columns.directions, first),
        corners: [eight_of(a, first), eight_of(b, first), eight_of(c, first)],
        t_min: eight(&columns.t_min, first),
        t_max: eight(&columns.t_max, first),
    }
}

/// Eight vectors, from `first` on.
#[inline(always)]
fn eight_of([x, y, z]: &[[f32; MAX_BATCH]; 3], first: usize) -> [[f32; WIDTH]; 3] {
    [eight(x, first), eight(y, first), eight(z, first)]
}

/// Eight numbers, from `first` on.
#[inline(always)]
fn eight(column: &[f32; MAX_BATCH], first: usize) -> [f32; WIDTH] {
    *column[first..].first_chunk().expect("there are whole eights")
}

impl Target<'_> {
    /// Calls `take` with the triangles that each of these rays may cross. It returns the `t` beyond which the ray
    /// needs no more triangles, a negative number for none; that saves visits if `NARROWS`.
    pub(super) fn visit_candidates<const NARROWS: bool>(
        &self,
        rays: &[Ray],
        take: impl FnMut(&Candidate) -> f32,
    ) {
        self.tracers.stream().visit_candidates(rays, &mut Sink::<_, NARROWS>(take));
    }

    /// Calls `list` with each crossing of consecutive rays, in no particular order, with `t` in the caller's units and
    /// the index of the ray counted from `first`. It returns false if no more are wanted; some may follow all the same.
    pub(super) fn list_crossings(
        &self,
        rays: &Rays<'_>,
        first: usize,
        len: usize,
        mut list: impl FnMut(u32, &Hit) -> bool,
    ) {
        let mut traced = RAYS.take();
        let tracer = self.tracers.stream();
        if rays.fill(first, len, self.center, &mut traced) {
            let (level, columns) = (tracer.simd(), &mut CandidateColumns::default());
            tracer.visit_candidates(&traced, &mut Lister { rays: &traced, level, columns, list, more: true });
            RAYS.set(traced);
            return;
        }
        RAYS.set(traced);
        self.visit_crossings::<false>(rays, first, len, |candidate, ray, crossing| {
            let more = list(candidate.ray as u32, &ray.hit(crossing, candidate.primitive));
            if more { f32::INFINITY } else { -1.0 }
        });
    }

    /// Adds the numbers of crossings of consecutive rays; of those that have `enough`, perhaps not all.
    pub(super) fn count_crossings(&self, rays: &Rays<'_>, first: usize, enough: u32, counts: &mut [u32]) {
        let (mut traced, len) = (RAYS.take(), counts.len());
        if rays.fill(first, len, self.center, &mut traced) {
            self.count_exactly(&traced, enough, counts);
            RAYS.set(traced);
            return;
        }
        RAYS.set(traced);
        self.visit_crossings::<false>(rays, first, len, |candidate, _, _| {
            let count = &mut counts[candidate.ray];
            *count += 1;
            if *count < enough { f32::INFINITY } else { -1.0 }
        });
    }

    /// [`Target::count_crossings`] of rays that are traced to the bit as they are.
    fn count_exactly(&self, rays: &[Ray], enough: u32, counts: &mut [u32]) {
        self.tracers.stream().visit_candidates(rays, &mut Counter { rays, counts, enough });
    }

    /// Calls `take` with each crossing of consecutive rays, in no particular order, where the candidate's ray counts
    /// from `first`.
    pub(super) fn visit_crossings<const NARROWS: bool>(
        &self,
        rays: &Rays<'_>,
        first: usize,
        len: usize,
        mut take: impl FnMut(&Candidate, &ExactRay, &Crossing) -> f32,
    ) {
        let mut traced = RAYS.take();
        let direct = NARROWS && rays.fill(first, len, self.center, &mut traced);
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
            let &Candidate { ray: index, primitive, corners } = candidate;
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
