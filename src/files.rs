//! Atomic writing of files: they appear whole or not at all.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use tempfile::TempPath;

/// A file could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{path}: cannot be written: {source}")]
pub struct NotWritten {
    /// The file.
    pub path: PathBuf,
    /// The error of the file system or of the encoder.
    pub source: io::Error,
}

/// Writes a file atomically: other processes see the old content or the whole new one. `encode` writes the
/// content. The permissions of an existing file are kept.
///
/// On Linux the file has no name while it is written, so nothing is left if the process is killed. Once
/// complete it gets the name `.raystream-NAME` in the same folder, and is then renamed to `path`. A kill
/// between these two calls leaves a complete file under the first name, which the next write of the same
/// `path` replaces. Where the system has no unnamed files, a kill while writing leaves a `.raystream-*` file.
///
/// # Errors
/// If the file system or `encode` fails. Then no file is created or changed.
pub fn write_atomically(
    path: &Path,
    encode: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), NotWritten> {
    let write = || {
        let (file, name) = create(folder(path))?;
        if let Ok(replaced) = std::fs::metadata(path) {
            file.set_permissions(replaced.permissions())?;
        }
        let mut file = BufWriter::new(file);
        encode(&mut file)?;
        let file = file.into_inner().map_err(io::IntoInnerError::into_error)?;
        match name {
            Some(name) => name.persist(path).map_err(|error| error.error),
            None => publish(&file, path),
        }
    };
    write().map_err(|source| NotWritten { path: path.into(), source })
}

fn folder(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A new file in a folder. Unnamed if the system can do that, else with its temporary name.
fn create(folder: &Path) -> io::Result<(File, Option<TempPath>)> {
    if let Some(file) = create_unnamed(folder) {
        return Ok((file, None));
    }
    let mut builder = tempfile::Builder::new();
    // The permissions of an ordinary new file, not the private ones of a temporary file.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let (file, name) = builder.prefix(".raystream-").tempfile_in(folder)?.into_parts();
    Ok((file, Some(name)))
}

#[cfg(target_os = "linux")]
fn create_unnamed(folder: &Path) -> Option<File> {
    use rustix::fs::{Mode, OFlags, open};
    // `publish` needs /proc to name the file.
    let file = open(folder, OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC, Mode::from(0o666)).ok()?;
    Path::new("/proc/self/fd").exists().then(|| file.into())
}

#[cfg(not(target_os = "linux"))]
fn create_unnamed(_: &Path) -> Option<File> {
    None
}

/// Names a complete unnamed file `path`.
#[cfg(target_os = "linux")]
fn publish(file: &File, path: &Path) -> io::Result<()> {
    use rustix::fs::{AtFlags, CWD, linkat};
    use std::os::fd::AsRawFd;
    // One writer at a time: writers of one path share the first name. Folders that cannot be locked are not
    // protected.
    let lock = File::open(folder(path))?;
    lock.lock().ok();
    let mut first_name = std::ffi::OsString::from(".raystream-");
    first_name.push(path.file_name().ok_or(io::ErrorKind::InvalidFilename)?);
    let first_path = folder(path).join(first_name);
    // A process that was killed may have left it.
    ignore_missing(std::fs::remove_file(&first_path))?;
    // Linking cannot replace an existing name, renaming can.
    linkat(CWD, &*format!("/proc/self/fd/{}", file.as_raw_fd()), CWD, &first_path, AtFlags::SYMLINK_FOLLOW)?;
    std::fs::rename(&first_path, path).inspect_err(|_| {
        std::fs::remove_file(&first_path).ok();
    })
}

#[cfg(target_os = "linux")]
fn ignore_missing(result: io::Result<()>) -> io::Result<()> {
    result.or_else(|error| if error.kind() == io::ErrorKind::NotFound { Ok(()) } else { Err(error) })
}

#[cfg(not(target_os = "linux"))]
fn publish(_: &File, _: &Path) -> io::Result<()> {
    unreachable!("no file is unnamed")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn names(folder: &Path) -> Vec<String> {
        let name = |entry: io::Result<std::fs::DirEntry>| entry.unwrap().file_name().into_string().unwrap();
        let mut names: Vec<_> = std::fs::read_dir(folder).expect("folder").map(name).collect();
        names.sort();
        names
    }

    #[test]
    fn a_failed_write_leaves_nothing_behind() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("a.png");
        std::fs::write(&path, "old").expect("file");
        let failure = write_atomically(&path, |file| {
            file.write_all(b"half")?;
            Err(io::Error::other("disk full"))
        });
        assert!(failure.expect_err("must fail").to_string().contains("disk full"));
        assert_eq!(std::fs::read(&path).expect("file"), b"old");
        assert_eq!(names(folder.path()), ["a.png"]);
        assert!(write_atomically(&folder.path().join("none/a.png"), |_| Ok(())).is_err());
    }

    /// Whatever exists during the write would be left by a kill.
    #[cfg(target_os = "linux")]
    #[test]
    fn nothing_has_a_name_before_it_is_whole() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("a.png");
        let write = |text: &[u8], there: &[&str]| {
            let written = write_atomically(&path, |file| {
                file.write_all(text)?;
                file.flush()?;
                assert_eq!(names(folder.path()), there);
                Ok(())
            });
            written.expect("written");
            assert_eq!(std::fs::read(&path).expect("file"), text);
            assert_eq!(names(folder.path()), ["a.png"]);
        };
        write(b"new", &[]);
        write(b"newer", &["a.png"]);
        // Left by a process that was killed between the two names.
        std::fs::write(folder.path().join(".raystream-a.png"), "left").expect("file");
        write(b"newest", &[".raystream-a.png", "a.png"]);
    }

    #[test]
    fn writers_of_one_file_do_not_mix() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("a");
        std::thread::scope(|scope| {
            for writer in 0..4 {
                let path = &path;
                scope.spawn(move || {
                    for _ in 0..50 {
                        write_atomically(path, |file| file.write_all(&[writer; 10_000])).expect("written");
                        let read = std::fs::read(path).expect("there is always a file");
                        assert!(read.len() == 10_000 && read.iter().all(|&byte| byte == read[0]));
                    }
                });
            }
        });
        assert_eq!(names(folder.path()), ["a"]);
    }
}
