//! The tree and the tracers over it: every tracer, at every SIMD level, gives the canonical answer.

mod bvh;
mod crowd;
mod exact;
mod members;
mod meshes;
mod rays;
