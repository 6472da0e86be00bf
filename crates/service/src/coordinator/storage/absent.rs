//! The place of S3 in a program that was built without it.

use super::{Objects, StorageOptions};
use tokio::sync::watch;

/// Refuses.
///
/// # Errors
/// Always.
pub(super) fn connect(_: &StorageOptions, _: watch::Receiver<bool>) -> Result<Box<dyn Objects>, String> {
    Err("--storage: this program was built without S3; build it with `--features s3`".into())
}
