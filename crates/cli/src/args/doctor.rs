//! `raystream doctor`.

use clap::Args;
use std::path::PathBuf;

/// `raystream doctor`.
#[derive(Debug, Args)]
pub struct DoctorArgs {
    /// The program: an executable or a library with symbols, built with optimisation.
    pub program: PathBuf,
}
