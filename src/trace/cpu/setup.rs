//! Before traversal: what the box tests need of each ray, and the lists of rays by octant.
//!
//! Unsafe code for rows and lists. Invariant 1: `SubStream::rows` has room for the rays and
//! `substream::PADDING` more, and each octant's arena for as many ids.
#![allow(unsafe_code, reason = "the invariants above")]

use super::shaft::{self, Growing};
use super::substream::{OctantStack, PADDING, ROW_BYTES, SubStream, lanes_of};
use crate::geom::{DIRECTION_RANGE, MAX_COORDINATE, MIN_COMPONENT, SLACK};
use crate::lanes::{Lanes, each};
use crate::stream::Ray;

/// Writes the rows of all rays, as [`crate::geom::CanonicalRay::new`] defines them, and puts the ids of
/// those that may hit something at the bottom of their octant's arena, padded; how many there are in each octant's list.
#[inline(always)]
pub(super) fn prepare<W: Lanes>(
    w: W,
    job: &SubStream<'_>,
    rays: &[Ray],
    stacks: &mut [OctantStack; 8],
) -> [usize; 8] {
    for stack in stacks.iter_mut() {
        stack.reserve(rays.len() + 2 * PADDING);
    }
    let mut counts = [0; 8];
    let ids: [u32; PADDING] = std::array::from_fn(|i| (i * ROW_BYTES) as u32);
    let ray_ids: [u32; PADDING] = std::array::from_fn(|i| (i * size_of::<Ray>()) as u32);
    let mut growing = Growing::new(w);
    for (i, some) in rays.chunks(W::LANES).enumerate() {
        let at = i * W::LANES;
        let among = lanes_of::<W>(some.len());
        let mut padded = [Ray::default(); PADDING];
        let from = if some.len() < W::LANES {
            padded[..some.len()].copy_from_slice(some);
            &padded
        } else {
            some
        };
        // SAFETY: `from` has a ray for each lane; invariant 1 for what is written.
        unsafe {
            let columns = w.rows(from.as_ptr().cast(), ray_ids.as_ptr());
            let origin = [columns[0], columns[1], columns[2]];
            let (columns, valid, signs) = rows(w, job.scene_max_abs, among, columns);
            growing.add(w, valid, origin, columns);
            let next = at + some.len();
            if next % shaft::RAYS == 0 || next == rays.len() {
                (*job.shafts)[at / shaft::RAYS] = growing.done(w);
                growing = Growing::new(w);
            }
            w.put_rows(job.rows.add(at).cast(), columns);
            let first = (at * ROW_BYTES) as u32;
            let here = ids.map(|id| id + first);
            let here = w.load_u32(here.as_ptr());
            for octant in 0..8 {
                let side = |axis: usize| if octant >> axis & 1 == 1 { signs[axis] } else { !signs[axis] };
                let members = valid & side(0) & side(1) & side(2);
                if members != 0 {
                    w.append(stacks[octant].ids.as_mut_ptr().add(counts[octant]), members, here);
                    counts[octant] += members.count_ones() as usize;
                }
            }
        }
    }
    for (stack, &count) in stacks.iter_mut().zip(&counts) {
        let first = stack.ids[0];
        stack.ids[count..count + PADDING].fill(first);
    }
    counts
}

/// Columns of rays to columns of rows; the lanes of rays that may hit something; the lanes whose
/// direction is negative on each axis.
#[inline(always)]
pub(super) fn rows<W: Lanes>(
    w: W,
    scene_max_abs: f32,
    among: u32,
    rays: [W::F; 8],
) -> ([W::F; 8], u32, [u32; 3]) {
    let [ox, oy, oz, t_min, dx, dy, dz, t_max] = rays;
    let [ax, ay, az] = each([dx, dy, dz], |d| w.abs(d));
    let [rx, ry, rz] = each([ox, oy, oz], |o| w.abs(o));
    let zero = w.splat(0.0);
    // And not −0: see `Slabs`.
    let t_max = w.add(t_max, zero);
    let mut valid = w.le(w.le(among, t_min, t_max), zero, t_max);
    // By their bits NaN is greater than all numbers.
    let reach = w.max_bits(w.max_bits(rx, ry), rz);
    let largest = w.max_bits(w.max_bits(ax, ay), az);
    valid = w.le(valid, reach, w.splat(MAX_COORDINATE));
    valid = w.le(valid, w.splat(*DIRECTION_RANGE.start()), largest);
    valid = w.le(valid, largest, w.splat(*DIRECTION_RANGE.end()));
    let floor = w.mul(largest, w.splat(MIN_COMPONENT));
    let slack = w.mul(w.max(w.splat(scene_max_abs), reach), w.splat(SLACK));
    let inverse = |size, d| w.div(w.splat(1.0), w.with_sign_of(w.max(size, floor), d));
    let (ix, iy, iz) = (inverse(ax, dx), inverse(ay, dy), inverse(az, dz));
    let shift = |o, inverse| w.sub(zero, w.mul(o, inverse));
    let columns = [ix, iy, iz, shift(ox, ix), shift(oy, iy), shift(oz, iz), slack, t_max];
    (columns, valid, each([dx, dy, dz], |d| w.signs(d)))
}
