//! Arguments of `raystream backup` and `raystream restore`.

use super::DataArgs;
use clap::Args;
use std::path::PathBuf;

/// `raystream backup` and `raystream restore`.
#[derive(Debug, Args)]
pub struct BackupArgs {
    /// The service.
    #[command(flatten)]
    pub of: DataArgs,
    /// Folder of the copy. What is written to, it or the data folder, is made, or is empty.
    pub folder: PathBuf,
}
