//! The ray/triangle test on its own, as the tracers run it.
//!
//! Unsafe code for loading lanes. Invariant 1: each column ends with [`MAX_LANES`] zeros beyond its numbers, so a
//! vector can be loaded at every number.
#![allow(unsafe_code, reason = "the invariants above")]

use glam::Vec3;
use raystream::geom::{CanonicalRay, SLACK};
use raystream::lanes::{LaneTask, Lanes, MAX_LANES, SimdLevel, first_lanes};
use raystream::stream::Ray;
use raystream::trace::cpu::lane_math::LaneVec3;
use raystream::trace::cpu::slabs::Slabs;
use raystream::trace::cpu::triangle::{Limits, Lines, test};

/// Contents of the lanes of a test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InLanes {
    /// Several rays, tested against one triangle.
    Rays,
    /// Several triangles, tested against one ray.
    Triangles,
}

/// Tests all rays against all triangles with the vectors of `level` (one lane at [`SimdLevel::Scalar`]) and returns the
/// number of hits.
///
/// # Panics
/// If a component of a ray's direction is negative.
pub fn count_hits(level: SimdLevel, in_lanes: InLanes, rays: &[Ray], triangles: &[[Vec3; 3]]) -> u64 {
    let task =
        CountHits { in_lanes, rays: RayColumns::new(rays), triangles: TriangleColumns::new(triangles) };
    level.run(task)
}

/// One number per ray or triangle, followed by [`MAX_LANES`] zeros (invariant 1).
struct Column(Vec<f32>);

impl Column {
    fn new(numbers: impl Iterator<Item = f32>) -> Self {
        let mut column: Vec<f32> = numbers.collect();
        column.resize(column.len() + MAX_LANES, 0.0);
        Self(column)
    }

    #[inline(always)]
    fn load<L: Lanes>(&self, l: L, at: usize) -> L::F {
        assert!(at + MAX_LANES <= self.0.len());
        // SAFETY: invariant 1.
        unsafe { l.load(self.0.as_ptr().add(at)) }
    }
}

fn columns(points: &[Vec3]) -> [Column; 3] {
    [0, 1, 2].map(|axis| Column::new(points.iter().map(|point| point[axis])))
}

#[inline(always)]
fn load<L: Lanes>(l: L, columns: &[Column; 3], at: usize) -> LaneVec3<L> {
    [columns[0].load(l, at), columns[1].load(l, at), columns[2].load(l, at)]
}

#[inline(always)]
fn splat<L: Lanes>(l: L, columns: &[Column; 3], at: usize) -> LaneVec3<L> {
    [l.splat(columns[0].0[at]), l.splat(columns[1].0[at]), l.splat(columns[2].0[at])]
}

struct RayColumns {
    len: usize,
    origin: [Column; 3],
    direction: [Column; 3],
    inverse: [Column; 3],
    shift: [Column; 3],
}

impl RayColumns {
    fn new(rays: &[Ray]) -> Self {
        let prepared = rays.iter().map(|r| CanonicalRay::new(r.origin, r.t_min, r.direction, r.t_max, 1.0));
        let prepared: Vec<CanonicalRay> = prepared.collect();
        let column =
            |of: &dyn Fn(&CanonicalRay) -> Vec3| columns(&prepared.iter().map(of).collect::<Vec<_>>());
        assert!(
            prepared.iter().all(|ray| ray.inverse.cmpge(Vec3::ZERO).all()),
            "directions must not have negative components"
        );
        Self {
            len: rays.len(),
            origin: column(&|ray| ray.origin),
            direction: column(&|ray| ray.direction),
            inverse: column(&|ray| ray.inverse),
            shift: column(&|ray| -(ray.origin * ray.inverse)),
        }
    }
}

struct TriangleColumns {
    len: usize,
    corners: [[Column; 3]; 3],
}

impl TriangleColumns {
    fn new(triangles: &[[Vec3; 3]]) -> Self {
        let corner = |i: usize| columns(&triangles.iter().map(|corners| corners[i]).collect::<Vec<_>>());
        Self { len: triangles.len(), corners: [corner(0), corner(1), corner(2)] }
    }
}

struct CountHits {
    in_lanes: InLanes,
    rays: RayColumns,
    triangles: TriangleColumns,
}

impl LaneTask for CountHits {
    type Output = u64;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> u64 {
        match self.in_lanes {
            InLanes::Rays => self.rays_in_lanes(l),
            InLanes::Triangles => self.triangles_in_lanes(l),
        }
    }
}

impl CountHits {
    #[inline(always)]
    fn rays_in_lanes<L: Lanes>(&self, l: L) -> u64 {
        let Self { rays, triangles, .. } = self;
        let mut hits = 0;
        for at in (0..rays.len).step_by(L::LANES) {
            let slabs = Slabs::new(l, load(l, &rays.inverse, at), load(l, &rays.shift, at), l.splat(SLACK));
            let (t_min, limit) = (l.splat(0.0), l.splat(f32::INFINITY));
            let limits = Limits { slabs: &slabs, octant: 0, t_min, limit };
            let lines = Lines { origin: load(l, &rays.origin, at), direction: load(l, &rays.direction, at) };
            for i in 0..triangles.len {
                let [a, b, c] = &triangles.corners;
                let triangle = [splat(l, a, i), splat(l, b, i), splat(l, c, i)];
                if let Some(found) = test(l, first_lanes::<L>(rays.len - at), &lines, &triangle, &limits) {
                    hits += u64::from(found.mask.count_ones());
                }
            }
        }
        hits
    }

    #[inline(always)]
    fn triangles_in_lanes<L: Lanes>(&self, l: L) -> u64 {
        let Self { rays, triangles, .. } = self;
        let mut hits = 0;
        for i in 0..rays.len {
            let slabs = Slabs::new(l, splat(l, &rays.inverse, i), splat(l, &rays.shift, i), l.splat(SLACK));
            let (t_min, limit) = (l.splat(0.0), l.splat(f32::INFINITY));
            let limits = Limits { slabs: &slabs, octant: 0, t_min, limit };
            let lines = Lines { origin: splat(l, &rays.origin, i), direction: splat(l, &rays.direction, i) };
            for at in (0..triangles.len).step_by(L::LANES) {
                let [a, b, c] = &triangles.corners;
                let triangle = [load(l, a, at), load(l, b, at), load(l, c, at)];
                let among = first_lanes::<L>(triangles.len - at);
                if let Some(found) = test(l, among, &lines, &triangle, &limits) {
                    hits += u64::from(found.mask.count_ones());
                }
            }
        }
        hits
    }
}
