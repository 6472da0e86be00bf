//! The canonical test of rays with one given triangle each, a pair in each lane: for hits that something else has
//! found, a device for example.
//!
//! Unsafe code for reading rays and corners. Invariant:
//! 1. Their arrays have an element for each lane of any vector.
#![allow(unsafe_code, reason = "the invariant above")]

use super::lane_math::LaneVec3;
use super::setup::{FIRST_IDS, RowColumns, row_columns};
use super::slabs::Slabs;
use super::triangle::{Bounds, BoundsFaces, EdgeValues, Limits, Lines, hits_inside};
use crate::lanes::{Lanes, MAX_LANES, first_lanes, spill};
use crate::stream::{Hit, Ray};
use glam::Vec3;

/// Pairs of a ray and a triangle, as many as lanes or fewer.
#[doc(hidden)]
pub struct RayTrianglePairs {
    len: usize,
    rays: [Ray; MAX_LANES],
    /// As `[vertex][axis][pair]`.
    corners: [[[f32; MAX_LANES]; 3]; 3],
}

impl Default for RayTrianglePairs {
    /// No pairs.
    fn default() -> Self {
        Self { len: 0, rays: [Ray::default(); MAX_LANES], corners: [[[0.0; MAX_LANES]; 3]; 3] }
    }
}

impl RayTrianglePairs {
    /// True without pairs.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Number of pairs.
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Adds a pair.
    ///
    /// # Panics
    /// If there are [`MAX_LANES`] already.
    #[inline(always)]
    pub fn push(&mut self, ray: &Ray, corners: &[Vec3; 3]) {
        let pair = self.len;
        self.rays[pair] = *ray;
        for (columns, corner) in self.corners.iter_mut().zip(corners) {
            columns[0][pair] = corner.x;
            columns[1][pair] = corner.y;
            columns[2][pair] = corner.z;
        }
        self.len += 1;
    }

    /// Takes all pairs, at most as many as lanes: the hits of pair `i` in element `i`, with the primitive id that
    /// `primitives` gives, or [`Hit::NONE`]. Elements beyond the pairs have no meaning.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn take_hits<L: Lanes>(
        &mut self,
        l: L,
        scene_max_abs: f32,
        primitives: &[u32; MAX_LANES],
    ) -> [Hit; MAX_LANES] {
        debug_assert!(self.len <= L::LANES);
        let among = first_lanes::<L>(std::mem::take(&mut self.len));
        // SAFETY: invariant 1.
        let rays = unsafe { l.rows(self.rays.as_ptr().cast(), FIRST_IDS.as_ptr()) };
        let [ox, oy, oz, t_min, dx, dy, dz, _] = rays;
        let RowColumns { columns, valid, negative } = row_columns(l, scene_max_abs, among, rays);
        let [ix, iy, iz, sx, sy, sz, slack, limit] = columns;
        let lines = Lines { origin: [ox, oy, oz], direction: [dx, dy, dz] };
        let triangle =
            [column(l, &self.corners[0]), column(l, &self.corners[1]), column(l, &self.corners[2])];
        let edges = EdgeValues::of(l, &lines, &triangle);
        let inside = edges.inside(l, valid);
        let Bounds { low, high } = Bounds::of(l, &triangle);
        let near = |axis: usize| l.select(negative[axis], high[axis], low[axis]);
        let far = |axis: usize| l.select(negative[axis], low[axis], high[axis]);
        let faces = BoundsFaces { near: [near(0), near(1), near(2)], far: [far(0), far(1), far(2)] };
        let slabs = Slabs::new(l, [ix, iy, iz], [sx, sy, sz], slack);
        // The octant does not count: the faces are given.
        let limits = Limits { slabs: &slabs, octant: 0, t_min: l.max(t_min, l.splat(0.0)), limit };
        let (mask, t) = hits_inside(l, inside, &lines, &triangle, &edges, &faces, &limits);
        let (u, v) = edges.barycentrics(l);
        let (t, u, v) = (spill(l, t), spill(l, u), spill(l, v));
        let mut hits = [Hit::NONE; MAX_LANES];
        for (pair, hit) in hits.iter_mut().enumerate().take(L::LANES) {
            if mask >> pair & 1 == 1 {
                *hit = Hit { t: t[pair], u: u[pair], v: v[pair], primitive: primitives[pair] };
            }
        }
        hits
    }
}

/// Corners in lanes.
#[inline(always)]
fn column<L: Lanes>(l: L, axes: &[[f32; MAX_LANES]; 3]) -> LaneVec3<L> {
    // SAFETY: invariant 1.
    unsafe { [l.load(axes[0].as_ptr()), l.load(axes[1].as_ptr()), l.load(axes[2].as_ptr())] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{CanonicalRay, mix};
    use crate::lanes::{LaneTask, SimdLevel};

    /// In [-1, 1), in steps of an eighth, so that rays meet edges, corners and zeros.
    fn coordinate(i: u32, k: u32) -> f32 {
        (mix(i ^ mix(k)) >> 28) as f32 / 8.0 - 1.0
    }

    fn point(i: u32, k: u32) -> Vec3 {
        Vec3::new(coordinate(i, k), coordinate(i, k + 1), coordinate(i, k + 2))
    }

    fn pair(i: u32) -> (Ray, [Vec3; 3]) {
        let corners = [point(i, 1), point(i, 4), point(i, 7)];
        let target = (corners[0] + corners[1] * 2.0 + corners[2]) / 4.0;
        let origin = point(i, 10) * 4.0;
        let mut ray = Ray::new(origin, if i.is_multiple_of(3) { point(i, 13) } else { target - origin });
        match i % 16 {
            0 => (ray.t_min, ray.t_max) = (0.5, 1.0),
            1 => ray.t_min = -1.0,
            2 => ray.t_max = f32::NAN,
            3 => ray.origin[1] = f32::INFINITY,
            4 => (ray.t_min, ray.t_max) = (1.0, 0.5),
            _ => {}
        }
        (ray, corners)
    }

    /// The hits of pairs, as many at a time as lanes, the last ones alone.
    struct All(u32);

    impl LaneTask for All {
        type Output = Vec<Hit>;

        #[cfg_attr(not(unoptimised), inline(always))]
        fn run<L: Lanes>(self, l: L) -> Vec<Hit> {
            let (mut pairs, mut hits, mut primitives) =
                (RayTrianglePairs::default(), Vec::new(), [0; MAX_LANES]);
            for i in 0..self.0 {
                primitives[pairs.len()] = i;
                let (ray, corners) = pair(i);
                pairs.push(&ray, &corners);
                if pairs.len() == L::LANES || i + 1 == self.0 {
                    let len = pairs.len();
                    hits.extend_from_slice(&pairs.take_hits(l, 4.0, &primitives)[..len]);
                }
            }
            hits
        }
    }

    #[test]
    fn pairs_have_the_canonical_hits_at_every_level() {
        let expected: Vec<Hit> = (0..10_003)
            .map(|i| {
                let (ray, [a, b, c]) = pair(i);
                let prepared = CanonicalRay::new(ray.origin, ray.t_min, ray.direction, ray.t_max, 4.0);
                let hit = prepared.triangle(a, b, c);
                hit.map_or(Hit::NONE, |hit| Hit { t: hit.t, u: hit.u, v: hit.v, primitive: i })
            })
            .collect();
        let hits = expected.iter().filter(|hit| !hit.is_miss()).count();
        assert!((2_000..9_000).contains(&hits), "{hits} hits");
        let bits = |hit: &Hit| [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.primitive];
        for level in SimdLevel::available() {
            let found = level.run(All(10_003));
            assert!(found.iter().map(bits).eq(expected.iter().map(bits)), "{level}");
        }
    }
}
