//! Rays on a mesh, on the SIMD lanes of all cores: the lowest crate of [raystream](https://docs.rs/raystream).
//!
//! Vertices and indices in, hits out: [`query`]. Hits are exact: [`geom`] defines each to the bit, and every tracer,
//! SIMD level and split of a stream finds the same.
//!
//! ```
//! use raystream_rays::glam::Vec3;
//! use raystream_rays::query::{Mesh, Ray};
//!
//! let mesh = Mesh::build(&[Vec3::ZERO, Vec3::X, Vec3::Y], &[[0, 1, 2]])?;
//! let ray = Ray::new(Vec3::new(0.2, 0.2, 1.0), -Vec3::Z);
//! let hit = mesh.closest_one(&ray);
//! assert_eq!((hit.t, hit.primitive), (1.0, 0));
//! # Ok::<(), raystream_rays::query::GeometryError>(())
//! ```
//!
//! ```text
//! lanes <- geom <- bvh <- trace::cpu <- query
//!                stream --^
//! ```
//!
//! Modules that these pages do not show (`bvh`, `trace`) may change in any release.

pub use {bytemuck, glam};

#[cfg_attr(not(feature = "unstable"), doc(hidden))]
pub mod bvh;
pub mod geom;
pub mod lanes;
pub mod memory;
#[cfg_attr(not(feature = "unstable"), doc(hidden))]
pub mod profile;
pub mod query;
pub mod stream;
mod sync;
#[cfg_attr(not(feature = "unstable"), doc(hidden))]
pub mod trace;
