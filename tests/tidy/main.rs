//! Documentation that cannot drift from the code: the rules of CONTRIBUTING.md that a program can check.
//!
//! Each rule reads the repository's files, collects all breaches with file and line, and fails once. Each rule also has
//! tests that plant a breach in a small tree and expect to see it named.

mod breach;
mod commands;
mod dependencies;
mod doc_lines;
mod generated;
mod imports;
mod links;
mod lints;
mod lists;
mod markdown;
mod numbers;
mod package;
mod pins;
mod results;
mod rust;
mod sizes;
mod text;
mod threats;
mod tree;
mod unsafe_code;
mod words;
