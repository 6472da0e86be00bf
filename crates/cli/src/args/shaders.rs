//! Arguments of `raystream shaders`.

use clap::Subcommand;
use std::path::PathBuf;

/// The subcommands of `raystream shaders`.
#[derive(Debug, Subcommand)]
pub enum ShadersCommand {
    /// Check shader files; list their parameters.
    Check {
        /// The files.
        #[arg(required = true, value_name = "FILE.wgsl")]
        files: Vec<PathBuf>,
    },
    /// Print what every shader can use: structs, functions, constants.
    Prelude,
}
