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
//! `src/ARCHITECTURE.md` is the map of the house.

pub mod files;
pub mod lanes;

pub mod geom;
pub mod scene;

pub mod bvh;
pub mod stream;

pub mod schedule;
pub mod trace;

pub mod query;

pub mod shade;

pub mod render;

pub mod engine;

pub mod film;

pub mod meters;

pub mod bench;

pub mod cli;

/// The README's example, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
