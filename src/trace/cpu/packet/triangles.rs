//! The triangles of a block as packets meet them.

use super::super::triangle::{Bounds, Hits, Passing, Range, Seen, Vector, dot, hits};
use super::Origin;
use crate::bvh::{LeafBlock, WIDTH};
use crate::lanes::{Lanes, keep, load, load_one, splat, splat_row, store_one};

/// The eight triangles of a block as seen from the origin, as columns.
#[repr(C, align(64))]
pub struct Triangles {
    edges: [[[f32; WIDTH]; 3]; 3],
    normal: [[f32; WIDTH]; 3],
    distance: [f32; WIDTH],
    low: [[f32; WIDTH]; 3],
    high: [[f32; WIDTH]; 3],
}

impl Triangles {
    #[inline(always)]
    pub fn new<E: Lanes>(e: E, origin: &Origin, block: LeafBlock<'_>) -> Self {
        let corners = block.vertices(e);
        let Seen { edges, normal, distance } = Seen::from(e, &splat(e, origin.point), &corners);
        let Bounds { low, high } = Bounds::of(e, &corners);
        Self {
            edges: [keep(e, edges[0]), keep(e, edges[1]), keep(e, edges[2])],
            normal: keep(e, normal),
            distance: store_one(e, distance),
            low: keep(e, low),
            high: keep(e, high),
        }
    }

    #[inline(always)]
    pub fn passing<L: Lanes>(&self, l: L, k: usize, direction: Vector<L>) -> Passing<L> {
        let [u, v, w] = &self.edges;
        Passing::new(l, &[splat_row(l, u, k), splat_row(l, v, k), splat_row(l, w, k)], direction)
    }

    #[inline(always)]
    pub fn hits<L: Lanes>(
        &self,
        l: L,
        k: usize,
        inside: u32,
        passing: &Passing<L>,
        direction: Vector<L>,
        range: &Range<'_, L>,
    ) -> Hits<L> {
        let facing = dot(l, splat_row(l, &self.normal, k), direction);
        let bounds = Bounds::<L> { low: splat_row(l, &self.low, k), high: splat_row(l, &self.high, k) };
        hits(l, inside, passing, [l.splat(self.distance[k]), facing], bounds.faces(range.octant), range)
    }

    /// Where the line of one ray passes all triangles.
    #[inline(always)]
    pub fn passed<E: Lanes>(&self, e: E, direction: Vector<E>) -> Passing<E> {
        let [u, v, w] = &self.edges;
        Passing::new(e, &[load(e, u), load(e, v), load(e, w)], direction)
    }

    /// Where one ray hits those that its line passes `inside`.
    #[inline(always)]
    pub fn hit<E: Lanes>(
        &self,
        e: E,
        inside: u32,
        passing: &Passing<E>,
        direction: Vector<E>,
        range: &Range<'_, E>,
    ) -> Hits<E> {
        let facing = dot(e, load(e, &self.normal), direction);
        let bounds = Bounds::<E> { low: load(e, &self.low), high: load(e, &self.high) };
        let distance = load_one(e, &self.distance);
        hits(e, inside, passing, [distance, facing], bounds.faces(range.octant), range)
    }
}
