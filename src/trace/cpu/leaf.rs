//! A list of rays meets a block of triangles.
//!
//! Unsafe code for rows and answers. The invariants are those of `stream`.
#![allow(unsafe_code)]

use super::lanes::{Lanes, load, spill, splat, splat_row};
use super::stream::{Answers, Job, ROW_BYTES, Row, lanes_of};
use super::triangle::{Passing, Range, Slabs, test};
use crate::bvh::{Block, MASKED};
use crate::stream::Hit;

/// Lists longer than this are tested many rays to a register, shorter ones eight triangles.
const MANY: usize = 8;

/// Tests all rays of a list with the first `count` triangles of a block.
///
/// # Safety
/// `list` is a list of `len` ids (invariants 1 and 2), and all its rays are of the octant.
#[allow(clippy::too_many_arguments)]
#[inline(always)]
pub(super) unsafe fn visit<W: Lanes, E: Lanes, const ANY: bool>(
    w: W,
    e: E,
    job: &Job<'_>,
    block: &Block,
    count: usize,
    octant: usize,
    list: *const u32,
    len: usize,
) {
    // SAFETY: as the caller vouches.
    unsafe {
        if len > MANY {
            rays_in_lanes::<W, ANY>(w, job, block, count, octant, list, len);
        } else {
            triangles_in_lanes::<E, ANY>(e, job, block, count, octant, list, len);
        }
    }
}

/// Many rays and one triangle at a time.
#[inline(always)]
unsafe fn rays_in_lanes<L: Lanes, const ANY: bool>(
    l: L,
    job: &Job<'_>,
    block: &Block,
    count: usize,
    octant: usize,
    list: *const u32,
    len: usize,
) {
    let mut at = 0;
    while at < len {
        // SAFETY: invariant 2.
        let ids = unsafe { list.add(at) };
        let mut among = lanes_of::<L>(len - at);
        at += L::LANES;
        // SAFETY: invariant 1.
        let (rays, row) =
            unsafe { (l.rows(job.rays.cast(), ids), l.rows(job.rows.cast(), ids)) };
        let [ox, oy, oz, t_min, dx, dy, dz, _] = rays;
        let [ix, iy, iz, sx, sy, sz, slack, limit] = row;
        let slabs = Slabs::new(l, [ix, iy, iz], [sx, sy, sz], slack);
        let mut range = Range { slabs: &slabs, octant, t_min: l.max(t_min, l.splat(0.0)), limit };
        if ANY {
            among = l.le(among, l.splat(0.0), limit);
        }
        for k in 0..count {
            let triangle = [
                splat_row(l, &block.vertices[0], k),
                splat_row(l, &block.vertices[1], k),
                splat_row(l, &block.vertices[2], k),
            ];
            let Some(hits) = test(l, among, &[ox, oy, oz], [dx, dy, dz], &triangle, &range) else {
                continue;
            };
            if hits.mask == 0 {
                continue;
            }
            let (ts, us, vs) = (spill(l, hits.t), spill(l, hits.u), spill(l, hits.v));
            let mut accepted = 0;
            let mut left = hits.mask;
            while left != 0 {
                let lane = left.trailing_zeros() as usize & 15;
                left &= left - 1;
                // SAFETY: invariant 1.
                let taken =
                    unsafe { job.offer::<ANY>(*ids.add(lane), block.ids[k], ts[lane], us[lane], vs[lane]) };
                accepted |= u32::from(taken) << lane;
            }
            if ANY {
                among &= !accepted;
                if among == 0 {
                    break;
                }
            } else {
                range.limit = l.select(accepted, hits.t, range.limit);
            }
        }
    }
}

/// One ray at a time and eight triangles.
#[inline(always)]
unsafe fn triangles_in_lanes<L: Lanes, const ANY: bool>(
    l: L,
    job: &Job<'_>,
    block: &Block,
    count: usize,
    octant: usize,
    list: *const u32,
    len: usize,
) {
    let among = lanes_of::<L>(count);
    let triangle = [load(l, &block.vertices[0]), load(l, &block.vertices[1]), load(l, &block.vertices[2])];
    // First which rays pass any triangle, without a branch on the way, then the rest for those.
    let (mut passing, mut some) = ([0; MANY], 0);
    for i in 0..len {
        // SAFETY: invariants 1 and 2.
        let (id, ray) = unsafe {
            let id = *list.add(i);
            (id, &*job.rays.byte_add(id as usize))
        };
        let (origin, direction) = (splat(l, ray.origin), splat(l, ray.direction));
        let inside = Passing::of(l, &origin, direction, &triangle).inside(l, among);
        passing[some & (MANY - 1)] = id;
        some += usize::from(inside != 0);
    }
    for &id in &passing[..some] {
        // SAFETY: invariant 1.
        let (row, ray) = unsafe {
            (&*job.rows.byte_add(id as usize).cast_const(), &*job.rays.byte_add(id as usize))
        };
        if ANY && row.limit < 0.0 {
            continue;
        }
        let Row { inverse, shift, slack, limit } = *row;
        let slabs = Slabs::new(l, splat(l, inverse), splat(l, shift), l.splat(slack));
        let (t_min, limit) = (l.splat(ray.t_min.max(0.0)), l.splat(limit));
        let range = Range { slabs: &slabs, octant, t_min, limit };
        let (origin, direction) = (splat(l, ray.origin), splat(l, ray.direction));
        let Some(hits) = test(l, among, &origin, direction, &triangle, &range) else { continue };
        if hits.mask == 0 {
            continue;
        }
        let (ts, us, vs) = (spill(l, hits.t), spill(l, hits.u), spill(l, hits.v));
        let mut left = hits.mask;
        while left != 0 {
            let lane = left.trailing_zeros() as usize & 7;
            left &= left - 1;
            // SAFETY: invariant 1.
            let taken = unsafe { job.offer::<ANY>(id, block.ids[lane], ts[lane], us[lane], vs[lane]) };
            if ANY && taken {
                break;
            }
        }
    }
}

impl Job<'_> {
    /// Takes a candidate that passed all tests but those of ties, of rivals in other lanes and of the
    /// filter, if it passes these too; says whether it did.
    ///
    /// # Safety
    /// Invariant 1 holds for `id`.
    #[inline(always)]
    unsafe fn offer<const ANY: bool>(&self, id: u32, stored: u32, t: f32, u: f32, v: f32) -> bool {
        let primitive = stored & !MASKED;
        let refused =
            || stored & MASKED != 0 && self.filter.is_some_and(|filter| !filter.accepts(primitive, u, v));
        let index = id as usize / ROW_BYTES;
        // SAFETY: invariant 1.
        let row = unsafe { &mut *self.rows.add(index) };
        match self.answers {
            Answers::Occluded(occluded) if ANY => {
                if refused() {
                    return false;
                }
                row.limit = -1.0;
                // SAFETY: invariant 1.
                unsafe { *occluded.add(index) = 1 };
            }
            Answers::Hits(hits) if !ANY => {
                // SAFETY: invariant 1.
                let hit = unsafe { &mut *hits.add(index) };
                // The row says how near the hit is: only a tie must read it.
                let nearer = t < row.limit || t == row.limit && primitive < hit.primitive;
                if !nearer || refused() {
                    return false;
                }
                row.limit = t;
                *hit = Hit { t, u, v, primitive };
            }
            _ => unreachable!("ANY says what the answers are"),
        }
        true
    }
}
