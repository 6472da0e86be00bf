//! Where things are kept that can be found out again.

use std::path::PathBuf;

/// The system's folder for caches, ours within it: `$XDG_CACHE_HOME` or `~/.cache`, `~/Library/Caches`,
/// `%LOCALAPPDATA%`. None where the system names none.
pub fn folder() -> Option<PathBuf> {
    Some(dirs::cache_dir()?.join("raystream"))
}
