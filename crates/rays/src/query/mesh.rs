//! A triangle mesh that answers ray queries.

use super::closed::{OpenMesh, open_edges};
use super::nearest::NearestPoint;
use super::nearest_lanes::nearest_of_each;
use super::points::Points;
use super::shares::answers_in_shares;
use super::target::{RayQueries, Target};
use super::tree_tracers::{SHARE_RAYS, TreeTracers};
use crate::bvh::{Bvh, GeometryError};
use crate::geom::MAX_COORDINATE;
use crate::stream::{Hit, Ray};
use crate::trace::cpu::{CpuTracer, SimdLevel};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::fmt;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// A triangle mesh with its tree, ready for ray queries. Cheap to clone: clones share the tree until one is
/// refitted.
#[derive(Clone)]
pub struct Mesh {
    tracers: TreeTracers,
    /// Subtracted from the caller's coordinates.
    center: DVec3,
    /// Number of open edges, once it has been asked for.
    open_edges: OnceLock<usize>,
}

impl Mesh {
    /// Builds a tree over `triangles`, which index `positions`. Row `i` of `triangles` is [`Hit::primitive`]
    /// `i`. Both sides of a triangle are hit. Accepts any triangles; degenerate ones are never hit.
    ///
    /// Positions may be arrays, or vectors of any version of glam. They are copied into the tree.
    ///
    /// ```
    /// use raystream_rays::query::Mesh;
    ///
    /// let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    /// let mesh = Mesh::build(&corners, &[[0, 1, 2]])?;
    /// assert_eq!(mesh.triangle_count(), 1);
    /// let error = Mesh::build(&corners, &[[0, 1, 3]]).unwrap_err();
    /// assert_eq!(error.to_string(), "triangle 0 names vertex 3, but there are 3 vertices");
    /// # Ok::<(), raystream_rays::query::GeometryError>(())
    /// ```
    ///
    /// # Errors
    /// If an index is out of range, a coordinate is not finite or exceeds [`crate::geom::MAX_COORDINATE`], or
    /// there are more than 130 million triangles.
    pub fn build<P>(positions: &[P], triangles: &[[u32; 3]]) -> Result<Self, GeometryError>
    where
        P: Copy + Into<[f32; 3]> + Sync,
    {
        let positions = vectors(positions);
        GeometryError::check(&positions, triangles)?;
        Ok(Self::of(Arc::new(Bvh::build(&positions, triangles, |_| false))))
    }

    /// [`Mesh::build`] with positions in `f64`, which may be far from the origin: they are stored relative to the
    /// middle of their box, [`Mesh::center`], each rounded to `f32`. So a coordinate is wrong by at most 2⁻²⁴ of its
    /// distance from the middle.
    ///
    /// Queries of [`RayQueries`] and of points take and give the caller's coordinates; rays and points in `f64` are not
    /// rounded to `f32` where exact answers depend on them. [`Mesh::closest`] and the other queries of [`Ray`] slices
    /// know nothing of the middle.
    ///
    /// ```
    /// use raystream_rays::query::{HitColumns, Mesh, Range, RayQueries, Rays, Rule};
    ///
    /// // A triangle of a metre, far away.
    /// let corners = [[4e6, 5e6, 0.0], [4e6 + 1.0, 5e6, 0.0], [4e6, 5e6 + 1.0, 0.0]];
    /// let mesh = Mesh::build64(&corners, &[[0, 1, 2]])?;
    /// let rays = [[4e6 + 0.25, 5e6 + 0.25, 2.0, 0.0, 0.0, -1.0]];
    /// let mut position = [[0.0; 3]];
    /// let mut columns = HitColumns { position64: Some(&mut position), ..HitColumns::default() };
    /// mesh.cast(&Rays::Rows64(&rays, Range::default()), Rule::Closed, &mut columns);
    /// assert_eq!(position, [[4e6 + 0.25, 5e6 + 0.25, 0.0]]);
    /// # Ok::<(), raystream_rays::query::GeometryError>(())
    /// ```
    ///
    /// # Errors
    /// As for [`Mesh::build`].
    pub fn build64(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<Self, GeometryError> {
        let (center, relative) = recentred(positions);
        let mesh = Self::build(&relative, triangles).map_err(|error| at_the_callers(error, positions))?;
        Ok(Self { center, ..mesh })
    }

    /// The point that the stored coordinates are relative to: zero, but for [`Mesh::build64`] and [`Mesh::refit64`].
    pub fn center(&self) -> DVec3 {
        self.center
    }

    /// Number of edges that an odd number of triangles have; 0 for a closed mesh. Edges are equal if their corners are
    /// at the same positions, whatever their indices are. Counted at the first call.
    pub fn open_edges(&self) -> usize {
        *self.open_edges.get_or_init(|| open_edges(self.bvh()))
    }

    /// True if the mesh has an inside: each edge has an even number of triangles.
    pub fn is_closed(&self) -> bool {
        self.open_edges() == 0
    }

    /// For each point, true if it lies inside the mesh or exactly on its surface, by the parity of one ray's crossings
    /// ([`super::Rule::HalfOpen`]): exact, without votes. On the current rayon pool.
    ///
    /// ```
    /// use raystream_rays::query::Mesh;
    ///
    /// let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    /// let mesh = Mesh::build(&corners, &[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])?;
    /// let points = [[0.1f32, 0.1, 0.1], [0.5, 0.5, 0.5], [0.0, 0.0, 0.0], [0.5, 0.5, 0.0]];
    /// let mut inside = [false; 4];
    /// mesh.contains(&points.as_slice().into(), &mut inside)?;
    /// assert_eq!(inside, [true, false, true, true]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// If the mesh is open.
    ///
    /// # Panics
    /// If there is not one answer per point.
    pub fn contains(&self, points: &Points<'_>, inside: &mut [bool]) -> Result<(), OpenMesh> {
        self.require_closed()?;
        self.contains_by_parity(points, inside);
        Ok(())
    }

    /// [`Mesh::contains`] of any mesh, which need not be closed: true if a ray from the point crosses the mesh an odd
    /// number of times. For an open mesh that depends on the ray, which goes away from the middle of the mesh's box.
    ///
    /// # Panics
    /// If there is not one answer per point.
    pub fn contains_by_parity(&self, points: &Points<'_>, inside: &mut [bool]) {
        self.target().contains(points, inside);
    }

    /// The distance of every point from the surface, negative inside and 0 on it. On the current rayon pool.
    ///
    /// # Errors
    /// If the mesh is open.
    ///
    /// # Panics
    /// If there is not one distance per point.
    pub fn signed_distances(&self, points: &Points<'_>, distances: &mut [f32]) -> Result<(), OpenMesh> {
        self.require_closed()?;
        self.signed_distances_by_parity(points, distances);
        Ok(())
    }

    /// [`Mesh::signed_distances`] of any mesh, with the sign of [`Mesh::contains_by_parity`].
    ///
    /// # Panics
    /// If there is not one distance per point.
    pub fn signed_distances_by_parity(&self, points: &Points<'_>, distances: &mut [f32]) {
        self.target().signed_distances(points, distances);
    }

    fn require_closed(&self) -> Result<(), OpenMesh> {
        match self.open_edges() {
            0 => Ok(()),
            edges => Err(OpenMesh { edges }),
        }
    }

    /// Of a tree that is already built; masked triangles are hit everywhere.
    #[doc(hidden)]
    pub fn of(bvh: Arc<Bvh>) -> Self {
        Self {
            tracers: TreeTracers::new(bvh, SimdLevel::detect()),
            center: DVec3::ZERO,
            open_edges: OnceLock::new(),
        }
    }

    /// Moves the triangles, as many as before. Answers are those of a new mesh, at a fraction of the time to
    /// build it; tracing slows down as neighbouring triangles move away from each other (see [`Bvh::refit`]).
    /// Clones are not moved.
    ///
    /// ```
    /// use raystream_rays::query::{Mesh, Ray};
    ///
    /// let mut corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    /// let mut mesh = Mesh::build(&corners, &[[0, 1, 2]])?;
    /// corners.iter_mut().for_each(|corner| corner[2] -= 1.0);
    /// mesh.refit(&corners, &[[0, 1, 2]])?;
    /// assert_eq!(mesh.closest_one(&Ray::new([0.2, 0.2, 1.0], [0.0, 0.0, -1.0])).t, 2.0);
    /// # Ok::<(), raystream_rays::query::GeometryError>(())
    /// ```
    ///
    /// A mesh of [`Mesh::build64`] becomes one of [`Mesh::build`]: its middle is the origin.
    ///
    /// # Errors
    /// As for [`Mesh::build`], and if the number of triangles has changed. The mesh is then unchanged.
    pub fn refit<P>(&mut self, positions: &[P], triangles: &[[u32; 3]]) -> Result<(), GeometryError>
    where
        P: Copy + Into<[f32; 3]> + Sync,
    {
        self.refit_around(DVec3::ZERO, &vectors(positions), triangles)
    }

    /// [`Mesh::refit`] with positions in `f64`, of any mesh. The middle moves, too: [`Mesh::center`] is that of the new
    /// positions' box, and the coordinates are stored and as exact as [`Mesh::build64`] says. Answers are to the bit
    /// those of a new mesh of [`Mesh::build64`].
    ///
    /// ```
    /// use raystream_rays::query::{HitColumns, Mesh, Range, RayQueries, Rays, Rule};
    ///
    /// let mut corners = [[4e6, 5e6, 0.0], [4e6 + 1.0, 5e6, 0.0], [4e6, 5e6 + 1.0, 0.0]];
    /// let mut mesh = Mesh::build64(&corners, &[[0, 1, 2]])?;
    /// corners.iter_mut().for_each(|corner| corner[0] -= 8e6);
    /// mesh.refit64(&corners, &[[0, 1, 2]])?;
    /// assert_eq!(mesh.center().x, 0.5 - 4e6);
    /// let rays = [[0.25 - 4e6, 5e6 + 0.25, 2.0, 0.0, 0.0, -1.0]];
    /// let mut t = [0.0];
    /// let mut columns = HitColumns { t: Some(&mut t), ..HitColumns::default() };
    /// mesh.cast(&Rays::Rows64(&rays, Range::default()), Rule::Closed, &mut columns);
    /// assert_eq!(t, [2.0]);
    /// # Ok::<(), raystream_rays::query::GeometryError>(())
    /// ```
    ///
    /// # Errors
    /// As for [`Mesh::refit`].
    pub fn refit64(&mut self, positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<(), GeometryError> {
        let (center, relative) = recentred(positions);
        let refitted = self.refit_around(center, &relative, triangles);
        refitted.map_err(|error| at_the_callers(error, positions))
    }

    /// Moves the triangles to positions that are relative to a point.
    fn refit_around(
        &mut self,
        center: DVec3,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
    ) -> Result<(), GeometryError> {
        self.bvh().accepts(positions, triangles)?;
        (self.center, self.open_edges) = (center, OnceLock::new());
        self.tracers.change(|bvh| bvh.refit(positions, triangles))
    }

    /// The nearest hit of every ray, or [`Hit::NONE`]. Of equally near hits the one with the lowest primitive
    /// id.
    pub fn closest(&self, rays: &[Ray]) -> Vec<Hit> {
        answers_in_shares(rays, Hit::NONE, SHARE_RAYS, |_, rays, hits| self.tracers.closest_here(rays, hits))
    }

    /// [`Mesh::closest`] into memory of the caller, as many hits as rays.
    ///
    /// # Panics
    /// If the two lengths differ.
    pub fn closest_into(&self, rays: &[Ray], hits: &mut [Hit]) {
        self.tracers.closest_into(rays, hits);
    }

    /// [`Mesh::closest`] of a single ray.
    ///
    /// ```
    /// use raystream_rays::query::{Mesh, Ray};
    ///
    /// let mesh = Mesh::build(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]])?;
    /// let ray = Ray::new([0.25, 0.5, 2.0], [0.0, 0.0, -1.0]);
    /// let hit = mesh.closest_one(&ray);
    /// assert_eq!((hit.t, hit.primitive), (2.0, 0));
    /// assert_eq!(ray.at(hit.t).to_array(), [0.25, 0.5, 0.0]);
    /// assert_eq!(mesh.normal(&hit).to_array(), [0.0, 0.0, 1.0]);
    /// # Ok::<(), raystream_rays::query::GeometryError>(())
    /// ```
    pub fn closest_one(&self, ray: &Ray) -> Hit {
        self.tracers.single().closest_one(ray)
    }

    /// The nearest hit of every ray among those that `accepts` returns true for. `accepts` gets the index of the
    /// ray in `rays` and the hit; what it refuses is as if it were not there.
    ///
    /// `accepts` must be a pure function. It is called for hits in no particular order, and not for all of
    /// them: a hit behind an accepted one may be left out. It may trace rays itself, on this mesh or another. If
    /// it panics, the panic reaches the caller.
    ///
    /// Every ray is traced by itself, as [`Mesh::closest_one`] does: for many rays that takes several times as long
    /// as [`Mesh::closest`], besides the time of `accepts`.
    ///
    /// ```
    /// use raystream_rays::query::{Mesh, Ray};
    ///
    /// // Two triangles, one above the other. No ray may hit the triangle that it starts on.
    /// let corners = [0.0, 1.0].map(|z| [[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]]);
    /// let mesh = Mesh::build(corners.as_flattened(), &[[0, 1, 2], [3, 4, 5]])?;
    /// let starts_on = [0, 1];
    /// let rays = [0.0, 1.0].map(|z| Ray::new([0.2, 0.2, z], [0.0, 0.0, 1.0]));
    /// let hits = mesh.closest_where(&rays, |ray, hit| hit.primitive != starts_on[ray]);
    /// assert_eq!((hits[0].t, hits[0].primitive), (1.0, 1));
    /// assert!(hits[1].is_miss());
    /// # Ok::<(), raystream_rays::query::GeometryError>(())
    /// ```
    pub fn closest_where(&self, rays: &[Ray], accepts: impl Fn(usize, &Hit) -> bool + Sync) -> Vec<Hit> {
        self.tracers.closest_where(rays, &accepts)
    }

    /// All hits of every ray. The second vector has a range of the first for each ray: its hits, nearest first,
    /// those at one distance by ascending primitive id. Triangles that lie upon each other are all there. A ray
    /// through an edge or a vertex hits all triangles that share it.
    ///
    /// Every ray is traced by itself, to its end. To count crossings, and for many rays, use
    /// [`RayQueries::list_hits`](super::RayQueries::list_hits) and its like.
    ///
    /// ```
    /// use raystream_rays::query::{Mesh, Ray};
    ///
    /// // The second triangle lies upon the first.
    /// let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    /// let mesh = Mesh::build(&corners, &[[0, 1, 2], [0, 1, 2]])?;
    /// let up = [0.25, 2.0].map(|x| Ray::new([x, 0.25, -1.0], [0.0, 0.0, 1.0]));
    /// let (hits, ranges) = mesh.all_hits(&up);
    /// assert_eq!(ranges, [0..2, 0..0]);
    /// assert_eq!(hits[ranges[0].clone()].iter().map(|hit| hit.primitive).collect::<Vec<_>>(), [0, 1]);
    /// # Ok::<(), raystream_rays::query::GeometryError>(())
    /// ```
    pub fn all_hits(&self, rays: &[Ray]) -> (Vec<Hit>, Vec<Range<usize>>) {
        self.tracers.all_hits(rays)
    }

    /// For each ray, true if it hits anything. Faster than [`Mesh::closest`].
    pub fn occluded(&self, rays: &[Ray]) -> Vec<bool> {
        self.tracers.occluded(rays)
    }

    /// [`Mesh::occluded`] into memory of the caller, as many answers as rays.
    ///
    /// # Panics
    /// If the two lengths differ.
    pub fn occluded_into(&self, rays: &[Ray], occluded: &mut [bool]) {
        self.tracers.occluded_into(rays, occluded);
    }

    /// [`Mesh::occluded`] of a single ray.
    ///
    /// ```
    /// use raystream_rays::query::{Mesh, Ray};
    ///
    /// let mesh = Mesh::build(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]])?;
    /// assert!(mesh.occluded_one(&Ray::new([0.25, 0.5, 2.0], [0.0, 0.0, -1.0])));
    /// assert!(!mesh.occluded_one(&Ray::new([0.25, 0.5, 2.0], [0.0, 0.0, 1.0])));
    /// # Ok::<(), raystream_rays::query::GeometryError>(())
    /// ```
    pub fn occluded_one(&self, ray: &Ray) -> bool {
        self.tracers.single().occluded_one(ray)
    }

    /// True if no triangle lies between two points; the points are included. For many pairs of points pass
    /// [`Ray::between`] them to [`Mesh::occluded`].
    ///
    /// ```
    /// use raystream_rays::query::Mesh;
    ///
    /// let mesh = Mesh::build(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]])?;
    /// assert!(!mesh.sees([0.2, 0.2, -1.0], [0.2, 0.2, 1.0]));
    /// assert!(mesh.sees([0.8, 0.8, -1.0], [0.8, 0.8, 1.0]));
    /// # Ok::<(), raystream_rays::query::GeometryError>(())
    /// ```
    pub fn sees(&self, from: impl Into<[f32; 3]>, to: impl Into<[f32; 3]>) -> bool {
        !self.occluded_one(&Ray::between(from, to))
    }

    /// The point of the mesh nearest to `point`, at most `max_distance` away, which may be +∞; of equally near
    /// points the one of the lowest primitive id. Degenerate triangles count as the segments or points that they
    /// are. `None` without a triangle so near, for a negative distance, and for a point with a coordinate that is
    /// NaN or exceeds [`crate::geom::MAX_COORDINATE`].
    ///
    /// Computed in `f64`, then rounded. Stays on the calling thread.
    ///
    /// ```
    /// use raystream_rays::query::Mesh;
    ///
    /// let mesh = Mesh::build(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]])?;
    /// let nearest = mesh.nearest_point([0.25, -3.0, 4.0], f32::INFINITY).expect("a triangle");
    /// assert_eq!((nearest.position.to_array(), nearest.distance), ([0.25, 0.0, 0.0], 5.0));
    /// assert!(mesh.nearest_point([0.25, -3.0, 4.0], 4.9).is_none());
    /// # Ok::<(), raystream_rays::query::GeometryError>(())
    /// ```
    pub fn nearest_point(&self, point: impl Into<[f32; 3]>, max_distance: f32) -> Option<NearestPoint> {
        let (point, mut nearest) = (Vec3::from_array(point.into()).as_dvec3(), [None]);
        nearest_of_each(self.bvh(), &[point], max_distance, &mut nearest);
        nearest[0]
    }

    /// The geometric normal of a hit, of length 1: that of the triangle's plane, on the side from which its
    /// corners are seen in counterclockwise order. Zero for a miss.
    ///
    /// # Panics
    /// If the mesh has no such primitive.
    pub fn normal(&self, hit: &Hit) -> Vec3 {
        if hit.is_miss() { Vec3::ZERO } else { normal(self.corners(hit.primitive)) }
    }

    /// The corners of a triangle.
    ///
    /// # Panics
    /// If the mesh has no such primitive.
    pub fn corners(&self, primitive: u32) -> [Vec3; 3] {
        self.bvh().corners(primitive)
    }

    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.bvh().len()
    }

    /// The mesh's tracer for many rays at a time, whose methods stay on the calling thread.
    pub fn tracer(&self) -> &CpuTracer {
        self.tracers.stream()
    }

    /// The tree. It knows its box and its size in bytes.
    pub fn bvh(&self) -> &Arc<Bvh> {
        self.tracers.bvh()
    }
}

impl RayQueries for Mesh {
    fn target(&self) -> Target<'_> {
        Target { tracers: &self.tracers, starts: None, center: self.center }
    }
}

impl fmt::Debug for Mesh {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut output = f.debug_struct("Mesh");
        output.field("triangles", &self.triangle_count()).field("bounds", &self.bvh().bounds());
        output.finish_non_exhaustive()
    }
}

/// Number of positions that one thread converts at a time.
const CONVERTED_AT_ONCE: usize = 1 << 14;

/// Positions as vectors, on the current rayon pool.
fn vectors<P: Copy + Into<[f32; 3]> + Sync>(positions: &[P]) -> Vec<Vec3> {
    let mut vectors = vec![Vec3::ZERO; positions.len()];
    let parts = vectors.par_chunks_mut(CONVERTED_AT_ONCE).zip(positions.par_chunks(CONVERTED_AT_ONCE));
    parts.for_each(|(vectors, positions)| {
        for (vector, &position) in vectors.iter_mut().zip(positions) {
            *vector = Vec3::from_array(position.into());
        }
    });
    vectors
}

/// The middle of the positions' box, and the positions relative to it, each rounded to `f32`. On the current rayon
/// pool.
fn recentred(positions: &[[f64; 3]]) -> (DVec3, Vec<Vec3>) {
    let join = |(low, high): (DVec3, DVec3), (other_low, other_high): (DVec3, DVec3)| {
        (low.min(other_low), high.max(other_high))
    };
    let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let around = |points: &[[f64; 3]]| {
        let points = points.iter().copied().map(DVec3::from_array);
        points.fold(empty, |bounds, point| join(bounds, (point, point)))
    };
    // Joined in their order: of equal numbers, 0 and -0, the last one stays.
    let parts: Vec<_> = positions.par_chunks(CONVERTED_AT_ONCE).map(around).collect();
    let (low, high) = parts.into_iter().fold(empty, join);
    let middle = 0.5 * low + 0.5 * high;
    let center = if middle.is_finite() { middle } else { DVec3::ZERO };
    let relative = |&point: &[f64; 3]| (DVec3::from_array(point) - center).as_vec3();
    (center, positions.par_iter().with_min_len(CONVERTED_AT_ONCE).map(relative).collect())
}

/// An error of recentred positions that tells the caller's coordinates. A vertex that is no number, or far away, moves
/// the middle, so that others are out of range; it is the one that is named.
fn at_the_callers(error: GeometryError, positions: &[[f64; 3]]) -> GeometryError {
    let GeometryError::Position { vertex, .. } = error else { return error };
    let mut points = positions.iter().copied().map(DVec3::from_array);
    let is_far = |point: DVec3| point.abs().max_element() > f64::from(MAX_COORDINATE);
    let wrong = points.clone().position(|point| !point.is_finite()).or_else(|| points.position(is_far));
    let vertex = wrong.unwrap_or(vertex);
    GeometryError::Position { vertex, at: DVec3::from_array(positions[vertex]).as_vec3() }
}

/// The unit normal of a triangle; zero if it has none.
pub(super) fn normal(corners: [Vec3; 3]) -> Vec3 {
    let [a, b, c] = corners.map(|corner| corner.as_dvec3());
    (b - a).cross(c - a).normalize_or_zero().as_vec3()
}
