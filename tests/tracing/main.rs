//! The tree and the tracers over it: every tracer, at every SIMD level, gives the canonical answer.

mod bvh;
mod exact;
mod meshes;
mod rays;
