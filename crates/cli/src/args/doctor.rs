//! `raystream doctor`.

use clap::Args;
use std::path::PathBuf;

/// `raystream doctor`.
#[derive(Debug, Args)]
pub struct DoctorArgs {
    /// The program: an executable or a library with symbols, built with optimisation. Of an .rlib, the library of a
    /// crate that is compiled with less optimisation, it looks for code over lanes, which belongs elsewhere.
    pub program: PathBuf,
}
