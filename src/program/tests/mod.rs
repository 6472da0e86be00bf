//! Tests of programs.

mod bsdfs;
mod fuzz;
mod generated;
mod oracle;
mod patterns;
mod recorded;
mod second_oracle;
