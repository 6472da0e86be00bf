//! Arguments, progress, reports; alone prints and exits.

mod args;
mod arrays;

pub use args::{Cli, Command};
