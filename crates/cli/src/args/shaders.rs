//! Arguments of `raystream shaders`.

use clap::Subcommand;
use std::path::PathBuf;

/// The subcommands of `raystream shaders`.
#[derive(Debug, Subcommand)]
pub enum ShadersCommand {
    /// Check shader files; list their parameters; measure whether BSDFs keep energy, densities and reciprocity.
    Check {
        /// The files.
        #[arg(required = true, value_name = "FILE.wgsl")]
        files: Vec<PathBuf>,
        /// Also write a picture of a ball with the surface where light of 0.5 arrives from everywhere: a surface that
        /// takes no light vanishes, one that makes light is brighter than the rest. Of one file.
        #[arg(long, value_name = "PICTURE")]
        furnace: Option<PathBuf>,
    },
    /// Print what every shader can use: structs, functions, constants.
    Prelude,
}
