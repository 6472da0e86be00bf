//! Ray queries on a mesh of your own: vertices and indices in, hits out.
//!
//! ```text
//! positions, triangles ─ Mesh::build → Mesh;   rays ─ closest → hits,   rays ─ occluded → booleans
//! ```
//!
//! Needs no scene file, service or device. [`crate::schedule::Service::closest`] has these and answers with
//! the same bits. Words are defined in `docs/glossary.md`.
//!
//! ```
//! use glam::Vec3;
//! use raystream::query::{Hit, Mesh, Ray};
//!
//! let square = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
//! let mesh = Mesh::build(&square, &[[0, 1, 2], [0, 2, 3]])?;
//! let down = Ray::new(Vec3::new(0.75, 0.5, 3.0), -Vec3::Z);
//! let beside = Ray::new(Vec3::new(1.5, 0.5, 3.0), -Vec3::Z);
//! assert_eq!(mesh.closest(&[down, beside]), [Hit { t: 3.0, u: 0.25, v: 0.5, primitive: 0 }, Hit::NONE]);
//! assert_eq!(mesh.occluded(&[down, beside]), [true, false]);
//! assert!(!mesh.sees(Vec3::new(0.5, 0.2, 1.0), Vec3::new(0.5, 0.2, -1.0)));
//! # Ok::<(), raystream::query::GeometryError>(())
//! ```
//!
//! # Speed
//! Pass many rays at once. A slice is divided into shares of up to 32 thousand rays, as many as the tracer
//! needs to be at its fastest. Neighbouring rays of a slice should be similar, but need not be sorted.
//!
//! # Threads
//! Everything runs on the current rayon pool: inside `pool.install(|| ...)` on that pool, else on the global
//! one. To trace on threads of your own, call the methods of [`Mesh::tracer`], which stay on the calling
//! thread. The answers do not depend on the threads.

mod shares;

pub(crate) use shares::in_shares;

pub use crate::bvh::GeometryError;
pub use crate::stream::{Hit, MISS, Ray};

use crate::bvh::Bvh;
use crate::stream::Tracer;
use crate::trace::cpu::{CpuTracer, SimdLevel};
use glam::Vec3;
use std::sync::Arc;

/// The largest number of rays that a thread traces at once.
pub(crate) const SHARE_RAYS: usize = 32 * 1024;

/// A triangle mesh with its tree, ready for ray queries. Cheap to clone: clones share the tree until one is
/// refitted.
#[derive(Clone)]
pub struct Mesh {
    bvh: Arc<Bvh>,
    tracer: CpuTracer,
}

impl Mesh {
    /// Builds a tree over `triangles`, which index `positions`. Row `i` of `triangles` is [`Hit::primitive`]
    /// `i`. Both sides of a triangle are hit. Accepts any triangles; degenerate ones are never hit.
    ///
    /// # Errors
    /// If an index is out of range, a coordinate is not finite or exceeds [`crate::geom::MAX_COORDINATE`], or
    /// there are more than 130 million triangles.
    pub fn build(positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<Self, GeometryError> {
        GeometryError::check(positions, triangles)?;
        Ok(Self::of(Arc::new(Bvh::build(positions, triangles, |_| false))))
    }

    /// Of a tree that is already built; masked triangles are hit everywhere.
    pub(crate) fn of(bvh: Arc<Bvh>) -> Self {
        let tracer = CpuTracer::new(bvh.clone(), None, SimdLevel::detect());
        Self { bvh, tracer: tracer.expect("the processor has the detected level") }
    }

    /// Moves the triangles, as many as before. Answers are those of a new mesh, at a fraction of the time to
    /// build it; tracing slows down as neighbouring triangles move away from each other (see [`Bvh::refit`]).
    /// Clones are not moved.
    ///
    /// # Errors
    /// As for [`Mesh::build`], and if the number of triangles has changed. The mesh is then unchanged.
    pub fn refit(&mut self, positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<(), GeometryError> {
        // Drops the tracer's reference first, so that the tree is copied only if a clone has it.
        let empty = Arc::new(Bvh::build(&[], &[], |_| false));
        let mut bvh = std::mem::replace(&mut self.bvh, empty.clone());
        *self = Self::of(empty);
        let refitted = match bvh.accepts(positions, triangles) {
            Ok(()) => Arc::make_mut(&mut bvh).refit(positions, triangles),
            Err(error) => Err(error),
        };
        *self = Self::of(bvh);
        refitted
    }

    /// The nearest hit of every ray, or [`Hit::NONE`]. Of equally near hits the one with the lowest primitive
    /// id.
    pub fn closest(&self, rays: &[Ray]) -> Vec<Hit> {
        let mut hits = vec![Hit::NONE; rays.len()];
        self.closest_into(rays, &mut hits);
        hits
    }

    /// [`Mesh::closest`] into memory of the caller, as many hits as rays.
    ///
    /// # Panics
    /// If the two lengths differ.
    pub fn closest_into(&self, rays: &[Ray], hits: &mut [Hit]) {
        assert_eq!(rays.len(), hits.len(), "one hit per ray");
        in_shares(rays, hits, SHARE_RAYS, |rays, hits| self.tracer.closest(rays, hits));
    }

    /// Whether each ray hits anything. Faster than [`Mesh::closest`].
    pub fn occluded(&self, rays: &[Ray]) -> Vec<bool> {
        let mut occluded = vec![0; rays.len()];
        self.occluded_into(rays, &mut occluded);
        occluded.into_iter().map(|occluded| occluded != 0).collect()
    }

    /// [`Mesh::occluded`] into memory of the caller, as many answers as rays: 1 for occluded, else 0.
    ///
    /// # Panics
    /// If the two lengths differ.
    pub fn occluded_into(&self, rays: &[Ray], occluded: &mut [u32]) {
        assert_eq!(rays.len(), occluded.len(), "one answer per ray");
        in_shares(rays, occluded, SHARE_RAYS, |rays, occluded| self.tracer.occluded(rays, occluded));
    }

    /// Whether no triangle lies between two points; the points are included. For many pairs of points pass
    /// [`Ray::between`] them to [`Mesh::occluded`].
    pub fn sees(&self, from: Vec3, to: Vec3) -> bool {
        !self.tracer.oracle().occluded_one(&Ray::between(from, to))
    }

    /// The mesh's tracer, whose methods stay on the calling thread.
    pub fn tracer(&self) -> &CpuTracer {
        &self.tracer
    }

    /// The tree. It knows its box, its size in bytes and the corners of triangles.
    pub fn bvh(&self) -> &Arc<Bvh> {
        &self.bvh
    }
}

#[cfg(all(test, feature = "bench"))]
mod tests {
    use super::*;
    use crate::bench::meshes;

    fn rays(count: usize) -> Vec<Ray> {
        let at = |i: u32| (crate::geom::mix(i) >> 8) as f32 / (1 << 24) as f32 * 80.0 - 40.0;
        let ray = |i: u32| {
            Ray::between(Vec3::new(at(3 * i), 30.0, at(3 * i + 1)), Vec3::new(at(3 * i + 2), -9.0, 0.0))
        };
        (0..count as u32).map(ray).collect()
    }

    #[test]
    fn answers_are_those_of_the_oracle_on_any_pool() {
        let (positions, triangles) = meshes::terrain(40);
        let mesh = Mesh::build(&positions, &triangles).expect("sound");
        let rays = rays(9000);
        let hits: Vec<Hit> = rays.iter().map(|ray| mesh.tracer().oracle().closest_one(ray)).collect();
        assert!(hits.iter().filter(|hit| !hit.is_miss()).count() > 4000);
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            assert_eq!(pool.install(|| mesh.closest(&rays)), hits);
            let occluded = pool.install(|| mesh.occluded(&rays));
            assert!(occluded.iter().zip(&hits).all(|(&occluded, hit)| occluded != hit.is_miss()));
        }
        assert!(mesh.closest(&[]).is_empty() && mesh.occluded(&[]).is_empty());
    }

    #[test]
    fn a_refit_moves_the_mesh_but_not_its_clones() {
        let (mut positions, triangles) = meshes::terrain(20);
        let mut mesh = Mesh::build(&positions, &triangles).expect("sound");
        let before = mesh.clone();
        let down = [Ray::new(Vec3::new(0.3, 90.0, 0.4), -Vec3::Y)];
        let t = mesh.closest(&down)[0].t;
        positions.iter_mut().for_each(|p| p.y += 1.0);
        assert_eq!(mesh.refit(&positions, &triangles), Ok(()));
        assert!((mesh.closest(&down)[0].t - (t - 1.0)).abs() < 1e-4);
        assert_eq!(before.closest(&down)[0].t, t);
        let moved = mesh.closest(&down);
        assert!(mesh.refit(&positions[1..], &triangles).is_err());
        assert!(mesh.refit(&positions, &triangles[1..]).is_err());
        assert_eq!(mesh.closest(&down), moved);
    }

    #[test]
    fn unsound_geometry_is_refused_by_name() {
        let error =
            |positions: &[Vec3]| Mesh::build(positions, &[[0, 1, 2]]).err().expect("unsound").to_string();
        assert!(error(&[Vec3::ZERO; 2]).contains("triangle 0 names vertex 2"));
        assert!(error(&[Vec3::ZERO, Vec3::splat(1e30), Vec3::X]).contains("vertex 1"));
        assert!(error(&[Vec3::ZERO, Vec3::X, Vec3::NAN]).contains("vertex 2"));
    }
}
