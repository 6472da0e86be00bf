//! Files of a frame: its sums while it is rendered, then its pictures.

use std::path::Path;

/// The name of pictures without their extension.
pub const PICTURE: &str = "picture";

/// Removes a file that is of no use any more, if it is there.
pub(super) fn remove(path: &Path) {
    if let Err(error) = std::fs::remove_file(path)
        && error.kind() != std::io::ErrorKind::NotFound
    {
        log::warn!("{}: cannot be removed: {error}", path.display());
    }
}
