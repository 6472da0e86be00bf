//! `raystream bench tables`: the tables of RTRT, measured here.

pub mod complexity;
pub mod effects;
pub mod kernels;
pub mod packets;
