//! Files that appear whole or not at all.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use tempfile::TempPath;

/// Why a file could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{path}: cannot be written: {source}")]
pub struct Unwritten {
    /// The file.
    pub path: PathBuf,
    /// What the file system or the encoder said.
    pub source: io::Error,
}

/// Writes a file that no reader ever sees half written.
///
/// On Linux what is being written has no name, so that nothing of it is left whenever the process is killed. Once
/// complete it gets a name beside `path` and at once that of `path`; a kill between these two calls leaves a
/// complete file under a name that the next write of the same `path` uses again. Where files without names cannot be
/// had, a kill while writing leaves a `.raystream-*` file.
///
/// # Errors
/// When the file system or `encode` refuses; then no file is left or changed.
pub fn write_whole(
    path: &Path,
    encode: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), Unwritten> {
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
    write().map_err(|source| Unwritten { path: path.into(), source })
}

fn folder(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A new file, with its name if it must have one.
fn create(folder: &Path) -> io::Result<(File, Option<TempPath>)> {
    if let Some(file) = nameless(folder) {
        return Ok((file, None));
    }
    let mut builder = tempfile::Builder::new();
    // The permissions of any new file, not the private ones of a temporary one.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let (file, name) = builder.prefix(".raystream-").tempfile_in(folder)?.into_parts();
    Ok((file, Some(name)))
}

#[cfg(target_os = "linux")]
fn nameless(folder: &Path) -> Option<File> {
    use rustix::fs::{Mode, OFlags, open};
    // A name is given by way of /proc.
    let file = open(folder, OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC, Mode::from(0o666)).ok()?;
    Path::new("/proc/self/fd").exists().then(|| file.into())
}

#[cfg(not(target_os = "linux"))]
fn nameless(_: &Path) -> Option<File> {
    None
}

/// Gives a complete nameless file its name.
#[cfg(target_os = "linux")]
fn publish(file: &File, path: &Path) -> io::Result<()> {
    use rustix::fs::{AtFlags, CWD, linkat};
    use std::os::fd::AsRawFd;
    // One writer at a time, for they share the name beside; where a folder cannot be locked they had better not meet.
    let turn = File::open(folder(path))?;
    turn.lock().ok();
    let mut beside = std::ffi::OsString::from(".raystream-");
    beside.push(path.file_name().ok_or(io::ErrorKind::InvalidFilename)?);
    let beside = folder(path).join(beside);
    // Left by a process that was killed.
    ignore_missing(std::fs::remove_file(&beside))?;
    // A name cannot be linked over another one, but renamed over it.
    linkat(CWD, &*format!("/proc/self/fd/{}", file.as_raw_fd()), CWD, &beside, AtFlags::SYMLINK_FOLLOW)?;
    std::fs::rename(&beside, path).inspect_err(|_| {
        std::fs::remove_file(&beside).ok();
    })
}

#[cfg(target_os = "linux")]
fn ignore_missing(result: io::Result<()>) -> io::Result<()> {
    result.or_else(|error| if error.kind() == io::ErrorKind::NotFound { Ok(()) } else { Err(error) })
}

#[cfg(not(target_os = "linux"))]
fn publish(_: &File, _: &Path) -> io::Result<()> {
    unreachable!("all files have names")
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
        let failure = write_whole(&path, |file| {
            file.write_all(b"half")?;
            Err(io::Error::other("disk full"))
        });
        assert!(failure.expect_err("must fail").to_string().contains("disk full"));
        assert_eq!(std::fs::read(&path).expect("file"), b"old");
        assert_eq!(names(folder.path()), ["a.png"]);
        assert!(write_whole(&folder.path().join("none/a.png"), |_| Ok(())).is_err());
    }

    /// What a kill at any moment of writing leaves is what there is then.
    #[cfg(target_os = "linux")]
    #[test]
    fn nothing_has_a_name_before_it_is_whole() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("a.png");
        let write = |text: &[u8], there: &[&str]| {
            let written = write_whole(&path, |file| {
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
        // What a process left that was killed between the two names.
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
                        write_whole(path, |file| file.write_all(&[writer; 10_000])).expect("written");
                        let read = std::fs::read(path).expect("there is always one");
                        assert!(read.len() == 10_000 && read.iter().all(|&byte| byte == read[0]));
                    }
                });
            }
        });
        assert_eq!(names(folder.path()), ["a"]);
    }
}
