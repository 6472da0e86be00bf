//! Speed beside its peers: what `raystream bench` measures.

pub mod adaptive;
pub mod build;
pub mod embree;
pub mod flat;
pub mod frame;
pub mod latency;
pub mod modelled_device;
pub mod noise;
mod order;
mod peers;
pub mod pictures;
pub mod povray;
#[cfg(feature = "gpu")]
pub mod raster;
pub mod rays;
pub mod rtrt;
pub mod schedule;
pub mod shaders;
pub mod small;
pub mod tables;
pub mod tail;
pub mod textures;
pub mod tinybvh;
pub mod triangle_test;
pub mod visits;
mod workload;

pub use order::Order;
pub use peers::{PeerError, Peers};
pub use raystream::meters::Spread;
pub use workload::{Kind, Workload};
