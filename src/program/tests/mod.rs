//! Tests of programs.

mod fuzz;
mod generated;
mod oracle;
mod patterns;
