//! Shaders in WGSL: loaded while raystream runs, and computed for blocks of hits in SIMD lanes.
//!
//! ```text
//! file ─naga→ valid module ─lower→ code: operations over columns ─run→ results
//!                                  (folded, inlined, unrolled)          a block of points at a time
//! ```
//!
//! Each operation is one operation of IEEE 754 binary32 or of 32-bit integers at each point, in the order of the
//! source, so every processor gives the same bits. `docs/design/wgsl-arithmetic.md` states what each means.

mod attribute;
mod bsdf;
mod code;
#[cfg(feature = "gpu")]
mod device;
mod diagnosis;
mod finish_call;
mod fuse;
#[cfg(feature = "gpu")]
pub mod gpu;
mod import;
pub mod integrator;
mod kernel;
mod loaded;
mod lower;
mod native;
mod operation;
mod parameter;
mod prelude;
mod repaired;
mod run;
mod shader;
#[doc(hidden)]
pub mod shipped;
mod source;
mod surface;
#[cfg(test)]
mod tests;
mod token;
mod translation;

pub use bsdf::BsdfShader;
pub use import::with_imports;
#[doc(hidden)]
pub use native::{ease, noise};
pub use parameter::Parameter;
pub use prelude::prelude;
pub use run::BLOCK;
pub use shader::SurfaceShader;
pub use source::{MAX_SOURCE_BYTES, ShaderError};
pub use surface::PatternShader;
