//! What a command tells of its work.

use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use raystream::film::tev::Tev;
use std::path::PathBuf;

/// The form in which progress is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum ProgressForm {
    /// A bar if standard error is a terminal, else lines.
    #[default]
    Auto,
    /// A bar on standard error.
    Bar,
    /// Lines on standard error, at least every five seconds.
    Plain,
    /// JSON objects on standard error, one a line, at least every five seconds.
    Json,
    /// Open Job Description's lines on standard output, at least every five seconds.
    Openjd,
}

/// Options of the reports that a command makes of its work.
#[derive(Debug, Args)]
pub struct ReportingArgs {
    /// Form in which progress is shown.
    #[arg(long, value_enum, value_name = "FORM", default_value_t)]
    pub progress: ProgressForm,
    /// Exit with code 1 if anything failed on the way (a lost GPU, say), even though the result is right.
    #[arg(long)]
    pub strict: bool,
    /// Show the picture in tev while it is rendered; tev listens at port 14158.
    #[arg(long, value_name = "HOST:PORT", alias = "display-server")]
    pub tev: Option<String>,
    /// Read options from a .toml or .json file. Its keys are the long names of options; options of the command line
    /// replace those of the file.
    #[arg(long, value_name = "FILE")]
    pub options: Option<PathBuf>,
}

/// A viewer at an address.
///
/// # Errors
/// If the system gives no thread.
pub fn viewer(address: &str) -> Result<Tev> {
    Tev::new(address).with_context(|| format!("--tev {address}"))
}
