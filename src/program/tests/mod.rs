//! Tests of programs.

mod patterns;
