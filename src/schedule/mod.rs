//! The heart: moves ray streams between EMPTY, NEEDMORE, TRACE and SHADE (RA section 3). Knows
//! neither scenes, pixels, devices nor SIMD; it meets them through [`Renderer`] and the tracer traits
//! of [`crate::stream`].

mod renderer;

pub use renderer::{Batch, Output, Renderer};
