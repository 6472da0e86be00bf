//! The triangles of a leaf block, as packets test them.

use super::super::lane_math::{LaneVec3, dot};
use super::super::triangle::{
    Bounds, EdgeValues, LaneHits, Limits, OriginTerms, PlaneProducts, hits_of_origin,
};
use super::columns::Origin;
use crate::bvh::{LeafBlock, WIDTH};
use crate::lanes::{LaneBits, Lanes, keep, load, load_one, splat, splat_row, store_one};

/// The [`OriginTerms`] and bounding boxes of a block's eight triangles, as columns.
#[repr(C, align(64))]
pub struct BlockTriangles {
    edge_normals: [[[f32; WIDTH]; 3]; 3],
    normal: [[f32; WIDTH]; 3],
    distance: [f32; WIDTH],
    low: [[f32; WIDTH]; 3],
    high: [[f32; WIDTH]; 3],
}

impl BlockTriangles {
    #[inline(always)]
    pub fn new<E: Lanes>(e: E, origin: &Origin, block: LeafBlock<'_>) -> Self {
        let corners = block.vertices(e);
        let OriginTerms { edge_normals, normal, distance } =
            OriginTerms::new(e, &splat(e, origin.point), &corners);
        let Bounds { low, high } = Bounds::of(e, &corners);
        Self {
            edge_normals: [keep(e, edge_normals[0]), keep(e, edge_normals[1]), keep(e, edge_normals[2])],
            normal: keep(e, normal),
            distance: store_one(e, distance),
            low: keep(e, low),
            high: keep(e, high),
        }
    }

    /// The edge values of triangle `k` for many rays.
    #[inline(always)]
    pub fn edge_values<L: Lanes>(&self, l: L, k: usize, direction: LaneVec3<L>) -> EdgeValues<L> {
        let [u, v, w] = &self.edge_normals;
        EdgeValues::new(l, &[splat_row(l, u, k), splat_row(l, v, k), splat_row(l, w, k)], direction)
    }

    /// The hits of rays with triangle `k`, whose interior their lines pass through in the lanes of `inside`.
    #[inline(always)]
    pub fn hits<L: Lanes>(
        &self,
        l: L,
        k: usize,
        inside: LaneBits,
        edges: &EdgeValues<L>,
        direction: LaneVec3<L>,
        limits: &Limits<'_, L>,
    ) -> LaneHits<L> {
        let facing = dot(l, splat_row(l, &self.normal, k), direction);
        let bounds = Bounds::<L> { low: splat_row(l, &self.low, k), high: splat_row(l, &self.high, k) };
        let plane = PlaneProducts { distance: l.splat(self.distance[k]), facing };
        hits_of_origin(l, inside, edges, &plane, &bounds.faces(limits.octant), limits)
    }

    /// The edge values of all triangles for one ray.
    #[inline(always)]
    pub fn edge_values_of_ray<E: Lanes>(&self, e: E, direction: LaneVec3<E>) -> EdgeValues<E> {
        let [u, v, w] = &self.edge_normals;
        EdgeValues::new(e, &[load(e, u), load(e, v), load(e, w)], direction)
    }

    /// The hits of one ray with the triangles of `inside`, whose interior its line passes through.
    #[inline(always)]
    pub fn hits_of_ray<E: Lanes>(
        &self,
        e: E,
        inside: LaneBits,
        edges: &EdgeValues<E>,
        direction: LaneVec3<E>,
        limits: &Limits<'_, E>,
    ) -> LaneHits<E> {
        let facing = dot(e, load(e, &self.normal), direction);
        let bounds = Bounds::<E> { low: load(e, &self.low), high: load(e, &self.high) };
        let plane = PlaneProducts { distance: load_one(e, &self.distance), facing };
        hits_of_origin(e, inside, edges, &plane, &bounds.faces(limits.octant), limits)
    }
}
