//! `raystream bench tables`, `bench povray` and `bench raster`: the tables of RTRT, measured here.

pub mod complexity;
#[cfg(feature = "gpu")]
pub mod crossover;
pub mod effects;
pub mod kernels;
pub mod packets;
pub mod povray;
