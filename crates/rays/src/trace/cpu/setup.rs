//! Set-up of a sub-stream: what the box tests need of each ray, and a list of rays per octant.
//!
//! Unsafe code for reading rays, writing rows and appending to lists. Invariants:
//! 1. [`prepare`] makes room for the rays and [`MAX_LANES`] more, in the rows and in the arena of each octant.
//! 2. Rays are read from slices that have one for each lane: the last ones are copied to an array first.
#![allow(unsafe_code, reason = "the invariants above")]

use super::shaft::{SHAFT_RAYS, ShaftBuilder, Shafts};
use super::substream::{OctantStack, ROW_BYTES, Row};
use crate::geom::{DIRECTION_RANGE, MAX_COORDINATE, MIN_COMPONENT, SLACK};
use crate::lanes::{LaneBits, Lanes, MAX_LANES, each, first_lanes, from_index};
use crate::stream::Ray;

/// Byte offsets of consecutive rows, and of rays: the ids of the first rays of a sub-stream.
pub(super) static FIRST_IDS: [u32; MAX_LANES] = {
    let mut ids = [0; MAX_LANES];
    let mut i = 0;
    while i < MAX_LANES {
        ids[i] = (i * ROW_BYTES) as u32;
        i += 1;
    }
    ids
};

/// Writes the rows and shafts of all rays, as [`crate::geom::CanonicalRay::new`] defines them. Writes the ids of rays
/// that may hit something to the bottom of their octant's arena, padded, and returns how many each octant has.
///
/// # Panics
/// If there are more rays than a sub-stream holds.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn prepare<W: Lanes>(
    w: W,
    scene_max_abs: f32,
    rays: &[Ray],
    rows: &mut Vec<Row>,
    shafts: &mut Shafts,
    stacks: &mut [OctantStack; 8],
) -> [usize; 8] {
    rows.resize(rows.len().max(rays.len() + MAX_LANES), Row::default());
    let rows = rows.as_mut_ptr();
    for stack in stacks.iter_mut() {
        stack.reserve(rays.len() + 2 * MAX_LANES);
    }
    let mut counts = [0; 8];
    let mut shaft = ShaftBuilder::new(w);
    for (i, some) in rays.chunks(W::LANES).enumerate() {
        let at = i * W::LANES;
        let among = first_lanes::<W>(some.len());
        let mut padded;
        let from = if some.len() < W::LANES {
            padded = [Ray::default(); MAX_LANES];
            padded[..some.len()].copy_from_slice(some);
            &padded
        } else {
            some
        };
        // SAFETY: invariant 2.
        let columns = unsafe { w.rows(from.as_ptr().cast(), FIRST_IDS.as_ptr()) };
        let origin = [columns[0], columns[1], columns[2]];
        let RowColumns { columns, valid, negative } = row_columns(w, scene_max_abs, among, columns);
        shaft.add(w, valid, origin, columns);
        let next = at + some.len();
        if next % SHAFT_RAYS == 0 || next == rays.len() {
            shafts[at / SHAFT_RAYS] = shaft.finish(w);
            shaft = ShaftBuilder::new(w);
        }
        let first = (at * ROW_BYTES) as u32;
        let ids: [u32; MAX_LANES] = from_index(|lane| FIRST_IDS[lane] + first);
        // SAFETY: invariant 1; `ids` is as long as the widest vector.
        unsafe {
            w.put_rows(rows.add(at).cast(), columns);
            let ids = w.load_u32(ids.as_ptr());
            for octant in 0..8 {
                let side =
                    |axis: usize| if octant >> axis & 1 == 1 { negative[axis] } else { !negative[axis] };
                let group = valid & side(0) & side(1) & side(2);
                if group != 0 {
                    w.append(stacks[octant].arena.as_mut_ptr().add(counts[octant]), group, ids);
                    counts[octant] += group.count_ones() as usize;
                }
            }
        }
    }
    for (stack, &count) in stacks.iter_mut().zip(&counts) {
        let first = stack.arena[0];
        stack.arena[count..count + MAX_LANES].fill(first);
    }
    counts
}

/// Rows of rays in lanes.
pub(super) struct RowColumns<L: Lanes> {
    /// The fields of [`Row`], one column each.
    pub columns: [L::F; 8],
    /// The lanes whose ray may hit something.
    pub valid: LaneBits,
    /// For each axis the lanes whose direction is negative.
    pub negative: [LaneBits; 3],
}

/// The rows of the rays in the lanes of `among`, from the rays' columns.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn row_columns<W: Lanes>(
    w: W,
    scene_max_abs: f32,
    among: LaneBits,
    rays: [W::F; 8],
) -> RowColumns<W> {
    let [ox, oy, oz, t_min, dx, dy, dz, t_max] = rays;
    let [ax, ay, az] = each([dx, dy, dz], |d| w.abs(d));
    let [rx, ry, rz] = each([ox, oy, oz], |o| w.abs(o));
    let zero = w.splat(0.0);
    // Adding +0 turns −0 into 0, as the integer comparisons of `Slabs` require of limits.
    let t_max = w.add(t_max, zero);
    let mut valid = w.le(w.le(among, t_min, t_max), zero, t_max);
    // By its bits NaN is greater than all numbers.
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
    RowColumns { columns, valid, negative: each([dx, dy, dz], |d| w.signs(d)) }
}
