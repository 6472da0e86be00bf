//! The folder of all that a service keeps: private, and used by one service at a time.

use super::ledger::{Ledger, LedgerError};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

/// The file that is locked while a service uses the folder.
const LOCK_FILE: &str = "lock";

/// The reason why a data folder cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FolderError {
    /// A service uses it.
    #[error("{0}: another service uses this folder; end it, or choose another (--data)")]
    InUse(PathBuf),
    /// The system refuses.
    #[error("{path}: {source}")]
    File {
        /// The file or folder.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The ledger cannot be used.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
}

/// A data folder that no other service uses for as long as the value lives.
#[derive(Debug)]
pub struct DataFolder {
    _lock: File,
}

impl DataFolder {
    /// Takes a folder, which is made if it is not there. Others than its owner may not enter it from here on.
    ///
    /// # Errors
    /// If another service uses it, or the system refuses.
    pub fn open(path: &Path) -> Result<Self, FolderError> {
        let failed = |path: PathBuf| move |source| FolderError::File { path, source };
        make_private(path).map_err(failed(path.to_owned()))?;
        let lock = path.join(LOCK_FILE);
        let file = File::create(&lock).map_err(failed(lock))?;
        file.try_lock().map_err(|_| FolderError::InUse(path.to_owned()))?;
        Ok(Self { _lock: file })
    }

    /// The ledger of a folder, and the folder unless a service uses it: commands may work beside one.
    ///
    /// # Errors
    /// If the folder or the ledger cannot be used.
    pub fn with_ledger(path: &Path) -> Result<(Option<Self>, Ledger), FolderError> {
        match Self::open(path) {
            Ok(own) => Ok((Some(own), Ledger::open(path)?)),
            Err(FolderError::InUse(_)) => Ok((None, Ledger::open_beside(path)?)),
            Err(error) => Err(error),
        }
    }
}

/// Makes the data folder, for its owner alone. One that is there becomes so: it holds secrets, scenes and pictures.
pub(super) fn make_private(data: &Path) -> io::Result<()> {
    if data.is_dir() {
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            if std::fs::metadata(data)?.permissions().mode() & 0o077 != 0 {
                std::fs::set_permissions(data, PermissionsExt::from_mode(0o700)).map_err(|error| {
                    let told =
                        format!("others may enter it, and that cannot be changed ({error}); choose another");
                    io::Error::other(told)
                })?;
                log::warn!(
                    "{}: others could enter it; it is its owner's alone now (mode 0700)",
                    data.display()
                );
            }
        }
        return Ok(());
    }
    let mut builder = std::fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(data)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn the_data_folder_is_its_owners_alone() {
        let folder = tempfile::tempdir().expect("a folder");
        let mode = |path: &Path| std::fs::metadata(path).expect("it").permissions().mode() & 0o777;
        let (open, new) = (folder.path().join("open"), folder.path().join("new"));
        std::fs::create_dir(&open).expect("a folder");
        std::fs::set_permissions(&open, PermissionsExt::from_mode(0o755)).expect("changed");
        for data in [&open, &new] {
            make_private(data).expect("made");
            assert_eq!(mode(data), 0o700);
        }
    }
}
