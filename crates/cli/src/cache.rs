//! The folder for calibrations and scenes that can be made or fetched again.

use std::path::PathBuf;

/// raystream's folder within the system's cache folder: `$XDG_CACHE_HOME` or `~/.cache`, `~/Library/Caches`,
/// `%LOCALAPPDATA%`. `None` where the system names none.
pub fn folder() -> Option<PathBuf> {
    Some(dirs::cache_dir()?.join("raystream"))
}
