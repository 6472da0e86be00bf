//! Speed beside its peers: what `raystream bench` measures.

pub mod build;
pub mod embree;
pub mod meshes;
pub mod rays;
mod workload;

pub use workload::{Kind, Workload};
