//! The tracer of the CPU, which turns rays into hits.

pub mod cpu;
