//! Ray queries on meshes of your own: vertices and indices in, hits out.
//!
//! ```text
//! positions, triangles ─ Mesh::build → Mesh;   rays ─ closest → hits,   rays ─ occluded → booleans
//! meshes, transforms ─ World::build → World, with the same queries
//! ```
//!
//! Needs no scene file, service or device. `raystream::schedule::Service::closest` has these and answers with
//! the same bits. Words are defined in `docs/glossary.md`.
//!
//! ```
//! use raystream_rays::glam::Vec3;
//! use raystream_rays::query::{Hit, Mesh, Ray};
//!
//! let square = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
//! let mesh = Mesh::build(&square, &[[0, 1, 2], [0, 2, 3]])?;
//! let down = Ray::new(Vec3::new(0.75, 0.5, 3.0), -Vec3::Z);
//! let beside = Ray::new(Vec3::new(1.5, 0.5, 3.0), -Vec3::Z);
//! assert_eq!(mesh.closest(&[down, beside]), [Hit { t: 3.0, u: 0.25, v: 0.5, primitive: 0 }, Hit::NONE]);
//! assert_eq!(mesh.occluded(&[down, beside]), [true, false]);
//! assert!(!mesh.sees(Vec3::new(0.5, 0.2, 1.0), Vec3::new(0.5, 0.2, -1.0)));
//! # Ok::<(), raystream_rays::query::GeometryError>(())
//! ```
//!
//! | question | call |
//! |---|---|
//! | what does a ray hit first? | [`Mesh::closest_one`], [`Mesh::closest`] for many |
//! | does it hit anything? | [`Mesh::occluded_one`], [`Mesh::occluded`] for many, [`Mesh::sees`] for two points |
//! | what does it hit first among some triangles, or by some rule? | [`Mesh::closest_where`] |
//! | what does it hit, all the way? | [`Mesh::all_hits`] |
//! | where, and what is there? | [`Ray::at`], [`Mesh::normal`], [`Mesh::corners`] |
//! | what does it hit, how often, in which columns? | [`RayQueries`], in any units, by either [`Rule`] |
//! | which point of the mesh is nearest to a point? | [`Mesh::nearest_point`], [`RayQueries::nearest_points`] |
//! | which points are inside, and how far? | [`Mesh::contains`], [`Mesh::signed_distances`] |
//! | what does a point see of its hemisphere? | [`hemispheres`] makes the rays |
//! | the same mesh at many places? | [`World`] |
//! | the mesh moves? | [`Mesh::refit`], [`Mesh::refit64`], [`World::move_instances`] |
//! | instances come and go? | [`World::add`], [`World::remove`], [`World::set_visible`], [`World::set_mesh`] |
//!
//! # Speed
//! A call may bring any number of rays: one or two are traced one after the other, more as a ray stream. The more
//! a call brings, the less each takes; 32 thousand are enough. Neighbouring rays of a slice should be similar, but
//! need not be sorted. `raystream bench small` measures calls of any length.
//!
//! # Threads
//! Up to 1024 rays are traced on the calling thread. More are divided among the current rayon pool: inside
//! `pool.install(|| ...)` that pool, else the global one. To trace on threads of your own, call the methods of
//! [`Mesh::tracer`], which stay on the calling thread. The answers do not depend on the threads.

mod closed;
mod columns;
mod crossings;
mod hemispheres;
mod in_order;
mod instance_starts;
mod lists;
mod mesh;
mod nearest;
mod nearest_lanes;
mod normals;
mod points;
mod rays;
mod rows;
mod shares;
mod target;
#[cfg(test)]
mod tests;
mod tree_tracers;
mod world;

pub use crate::bvh::{Bvh, GeometryError};
pub use crate::geom::{Placement, PlacementError};
pub use crate::stream::{Hit, MISS, Ray};
pub use crate::trace::cpu::{CpuTracer, SimdError, SimdLevel};
pub use closed::OpenMesh;
pub use columns::{Attribute, HitColumns, Interpolated, VertexNormals};
pub use hemispheres::{Hemisphere, hemispheres};
pub use lists::{HitListColumns, HitLists};
pub use mesh::Mesh;
pub use nearest::NearestPoint;
pub use points::{NearestColumns, Points};
pub use rays::{Range, Rays, Rule};
pub use target::RayQueries;
pub use world::{World, WorldError, WorldHit};

#[doc(hidden)]
pub use shares::in_shares;
#[doc(hidden)]
pub use tree_tracers::SHARE_RAYS;
