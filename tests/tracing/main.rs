//! The BVH and the tracers: every tracer, at every SIMD level, gives the canonical answer.

mod bvh;
mod exact;
mod instanced_scenes;
mod instances;
mod meshes;
mod rays;
