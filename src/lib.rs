//! **raystream** moves large buffers of arbitrary rays (*ray streams*) between a GPU and the CPU
//! cores of one machine: after *Ray Accelerator* (Barringer, Andersson, Akenine-Möller 2017; "RA")
//! and *Interactive Rendering with Coherent Ray Tracing* (Wald et al. 2001; "RTRT").
//!
//! The modules stand in the order in which the data flows:
//!
//! ```text
//! scene file ─load→ scene ─build→ bvh ─▶ stream ─▶ schedule ⇄ trace, shade, render ─▶ film
//! ```
//!
//! `src/ARCHITECTURE.md` is the map of the modules.

#[cfg(feature = "formats")]
pub mod files;
pub mod lanes;
#[cfg(feature = "render")]
pub mod memory;
#[cfg(feature = "render")]
mod sync;

pub mod geom;
#[cfg(feature = "render")]
pub mod scene;

pub mod bvh;
pub mod stream;

#[cfg(feature = "render")]
pub mod schedule;
pub mod trace;

#[cfg(feature = "query")]
pub mod query;

#[cfg(feature = "render")]
pub mod shade;

#[cfg(feature = "render")]
pub mod render;

#[cfg(feature = "render")]
pub mod engine;

#[cfg(feature = "render")]
pub mod film;

#[cfg(any(feature = "bench", feature = "cli"))]
pub mod meters;

#[cfg(feature = "bench")]
pub mod bench;

#[cfg(feature = "cli")]
pub mod cli;

/// The programs of README and guides, compiled, and run where they need no arguments.
#[cfg(all(doctest, feature = "cli"))]
mod documents {
    #[doc = include_str!("../README.md")]
    struct Readme;
    #[doc = include_str!("../docs/guide/add-a-bsdf.md")]
    struct AddABsdf;
    #[doc = include_str!("../docs/guide/add-a-format.md")]
    struct AddAFormat;
    #[doc = include_str!("../docs/guide/add-a-tracer.md")]
    struct AddATracer;
    #[doc = include_str!("../docs/guide/add-an-integrator.md")]
    struct AddAnIntegrator;
}
