//! Tests of programs.

mod generated;
mod oracle;
mod patterns;
