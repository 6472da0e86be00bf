//! Speed beside its peers: what `raystream bench` measures.

pub mod adaptive;
pub mod build;
pub mod embree;
pub mod frame;
pub mod latency;
#[cfg(feature = "serve")]
pub mod live;
pub mod meshes;
pub mod modelled_device;
pub mod noise;
mod order;
pub mod pictures;
pub mod rays;
pub mod schedule;
#[cfg(feature = "wgsl")]
pub mod shaders;
pub mod small;
pub mod tables;
pub mod tail;
pub mod textures;
pub mod triangle_test;
mod workload;

pub use crate::meters::Spread;
pub use order::Order;
pub use workload::{Kind, Workload};
