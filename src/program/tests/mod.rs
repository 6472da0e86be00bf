//! Tests of programs.

mod bsdfs;
mod built_ins;
mod corpus;
mod fuzz;
mod generated;
mod mistakes;
mod oracle;
mod patterns;
mod pictures;
mod recorded;
mod second_oracle;
