//! Writing of files: regular files appear whole or not at all.

use std::fs::File;
use std::io::{self, BufWriter, Seek};
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

/// The most symbolic links that are followed, as on Linux.
const MAX_LINKS: usize = 40;

/// Target of a path to be written, symbolic links followed.
enum Destination {
    /// A regular file of this path, or none yet.
    Regular(PathBuf),
    /// A device, a pipe, a socket, or an open file of a process (`/dev/stdout`): whoever holds it waits for the
    /// content, so another file must not take its name.
    Stream(PathBuf),
}

impl Destination {
    fn of(path: &Path) -> io::Result<Self> {
        let mut path = path.to_owned();
        for _ in 0..=MAX_LINKS {
            let kind = match std::fs::symlink_metadata(&path) {
                Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Self::Regular(path)),
                data => data?.file_type(),
            };
            if kind.is_dir() {
                return Err(io::Error::other("it is a directory"));
            }
            if kind.is_file() {
                return Ok(Self::Regular(path));
            }
            let folder = folder(&path).canonicalize()?;
            // Links of /proc name what is open, which may have another path or none.
            if !kind.is_symlink() || folder.starts_with("/proc") {
                return Ok(Self::Stream(path));
            }
            path = folder.join(std::fs::read_link(&path)?);
        }
        Err(io::Error::other("too many symbolic links"))
    }
}

/// Writes a file; `encode` writes the content. Symbolic links are followed.
///
/// A regular file is replaced atomically: other processes see the old content or the whole new one. The permissions
/// of an existing file are kept. Into a device or a pipe the whole content is copied once it is encoded.
///
/// On Linux the file has no name while it is written, so nothing is left if the process is killed. Once
/// complete it gets the name `.raystream-NAME` in the same folder, and is then renamed to `path`. A kill
/// between these two calls leaves a complete file under the first name, which the next write of the same
/// `path` replaces. Where the system has no unnamed files, a kill while writing leaves a `.raystream-*` file.
///
/// # Errors
/// If the file system or `encode` fails. Then no regular file is created or changed.
pub fn write(
    path: &Path,
    encode: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), NotWritten> {
    let write = || match Destination::of(path)? {
        Destination::Regular(path) => replace(&path, encode),
        Destination::Stream(path) => {
            let mut file = BufWriter::new(tempfile::tempfile().map_err(without_name)?);
            encode(&mut file)?;
            let mut file = file.into_inner().map_err(io::IntoInnerError::into_error)?;
            file.rewind()?;
            // Appending, because an open file of a process may hold other content.
            io::copy(&mut file, &mut File::options().append(true).open(path)?)?;
            Ok(())
        }
    };
    write().map_err(|source| NotWritten { path: path.into(), source })
}

/// Replaces or creates a regular file.
fn replace(path: &Path, encode: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> io::Result<()> {
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
}

/// Looks whether a file can be written, before time is spent on its content. The file is neither created nor changed.
/// Its folder may be missing, if [`make_folder`] can make it.
///
/// # Errors
/// If [`write`] would fail with what is known now.
pub fn check_writable(path: &Path) -> Result<(), NotWritten> {
    let check = || match Destination::of(path)? {
        Destination::Regular(path) => create(existing(folder(&path))).map(drop),
        // Opening a pipe would wait for its reader.
        Destination::Stream(_) => Ok(()),
    };
    check().map_err(|source| NotWritten { path: path.into(), source })
}

/// Makes the folder that a file is to be written into, and those above it, if they are missing. Done once, before the
/// work: a folder that vanishes later is an error, and no second one of its name appears.
///
/// # Errors
/// If the file system refuses.
pub fn make_folder(path: &Path) -> Result<(), NotWritten> {
    let make = || match Destination::of(path)? {
        Destination::Regular(path) => std::fs::create_dir_all(folder(&path)),
        Destination::Stream(_) => Ok(()),
    };
    make().map_err(|source| NotWritten { path: path.into(), source })
}

/// The one path of the regular file that a path names or would create: equal for two paths that name one file. `None`
/// for devices and pipes, and for what cannot be looked up.
pub fn identity(path: &Path) -> Option<PathBuf> {
    let Destination::Regular(path) = Destination::of(path).ok()? else { return None };
    match path.canonicalize() {
        Ok(path) => Some(path),
        Err(_) => {
            let there = existing(folder(&path));
            let missing = path.strip_prefix(there).unwrap_or(&path);
            Some(there.canonicalize().ok()?.join(missing))
        }
    }
}

/// The folder itself, or the nearest one above it that exists.
fn existing(folder: &Path) -> &Path {
    let above = |folder: &&Path| !folder.as_os_str().is_empty();
    let mut folders = folder.ancestors().filter(above);
    folders.find(|folder| std::fs::symlink_metadata(folder).is_ok()).unwrap_or(Path::new("."))
}

/// Makes the names in a folder last: what was renamed into it is there after a power failure too.
///
/// # Errors
/// If the file system refuses. Systems that cannot open folders are not asked.
pub fn sync_folder(folder: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
}

/// An error of a temporary file, without the file's name, which would tell the user nothing.
fn without_name(error: io::Error) -> io::Error {
    error.kind().into()
}

fn folder(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A new file in a folder. Unnamed if the system can do that, else with its temporary name.
fn create(folder: &Path) -> io::Result<(File, Option<TempPath>)> {
    if let Some(file) = create_unnamed(folder) {
        return Ok((file, None));
    }
    // The system's own error, if there is no such folder.
    std::fs::metadata(folder)?;
    let mut builder = tempfile::Builder::new();
    // The permissions of an ordinary new file, not the private ones of a temporary file.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let (file, name) = builder.prefix(".raystream-").tempfile_in(folder).map_err(without_name)?.into_parts();
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
        let failure = write(&path, |file| {
            file.write_all(b"half")?;
            Err(io::Error::other("disk full"))
        });
        assert!(failure.expect_err("must fail").to_string().contains("disk full"));
        assert_eq!(std::fs::read(&path).expect("file"), b"old");
        assert_eq!(names(folder.path()), ["a.png"]);
        assert!(write(&path.join("a.png"), |_| Ok(())).is_err(), "a file is no folder");
    }

    #[test]
    fn missing_folders_are_made_once() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("new/set/a.png");
        check_writable(&path).expect("can be made");
        assert!(names(folder.path()).is_empty(), "to look makes nothing");
        let other = folder.path().join("new/../new/set/a.png");
        assert_eq!(identity(&path), Some(folder.path().canonicalize().expect("there").join("new/set/a.png")));
        let whole = |file: &mut BufWriter<File>| file.write_all(b"whole");
        write(&path, whole).expect_err("writing makes no folder");
        make_folder(&path).expect("made");
        write(&path, whole).expect("written");
        assert_eq!(std::fs::read(&path).expect("file"), b"whole");
        assert_eq!(identity(&path), identity(&other));
    }

    /// Whatever exists during the write would be left by a kill.
    #[cfg(target_os = "linux")]
    #[test]
    fn nothing_has_a_name_before_it_is_whole() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("a.png");
        let write_anew = |text: &[u8], there: &[&str]| {
            let written = write(&path, |file| {
                file.write_all(text)?;
                file.flush()?;
                assert_eq!(names(folder.path()), there);
                Ok(())
            });
            written.expect("written");
            assert_eq!(std::fs::read(&path).expect("file"), text);
            assert_eq!(names(folder.path()), ["a.png"]);
        };
        write_anew(b"new", &[]);
        write_anew(b"newer", &["a.png"]);
        // Left by a process that was killed between the two names.
        std::fs::write(folder.path().join(".raystream-a.png"), "left").expect("file");
        write_anew(b"newest", &[".raystream-a.png", "a.png"]);
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
                        write(path, |file| file.write_all(&[writer; 10_000])).expect("written");
                        let read = std::fs::read(path).expect("there is always a file");
                        assert!(read.len() == 10_000 && read.iter().all(|&byte| byte == read[0]));
                    }
                });
            }
        });
        assert_eq!(names(folder.path()), ["a"]);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn links_are_followed_and_streams_are_written_into() {
        use std::os::unix::fs::{FileTypeExt, symlink};
        let folder = tempfile::tempdir().expect("folder");
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("sub")).expect("folder");
        symlink("sub/a", at("link")).expect("link");
        symlink("link", at("chain")).expect("link");
        symlink("round", at("round")).expect("link");
        let text = |text: &'static [u8]| move |file: &mut BufWriter<File>| file.write_all(text);
        // The first write creates what a link to nothing names.
        for (name, content) in [("link", b"one"), ("chain", b"two")] {
            assert_eq!(identity(&at(name)), identity(&at("sub/../sub/a")));
            check_writable(&at(name)).expect("writable");
            write(&at(name), text(content)).expect("written");
            assert_eq!(std::fs::read(at("sub/a")).expect("file"), content);
            assert!(std::fs::symlink_metadata(at(name)).expect("link").is_symlink());
        }
        assert_ne!(identity(&at("a")), identity(&at("sub/a")));
        let round = write(&at("round"), text(b"x")).expect_err("a circle").to_string();
        assert!(round.contains("too many symbolic links"), "{round}");

        rustix::fs::mknodat(
            rustix::fs::CWD,
            at("pipe"),
            rustix::fs::FileType::Fifo,
            rustix::fs::Mode::from(0o600),
            0,
        )
        .expect("a pipe");
        assert_eq!(identity(&at("pipe")), None);
        check_writable(&at("pipe")).expect("does not wait for a reader");
        let read = std::thread::scope(|scope| {
            let reader = scope.spawn(|| std::fs::read(at("pipe")).expect("content"));
            write(&at("pipe"), text(b"through")).expect("written");
            reader.join().expect("the reader ends")
        });
        assert_eq!(read, b"through");
        assert!(std::fs::symlink_metadata(at("pipe")).expect("pipe").file_type().is_fifo());
        write(Path::new("/dev/null"), text(b"x")).expect("written");
        assert!(!std::fs::symlink_metadata("/dev/null").expect("device").is_file());
    }

    #[test]
    fn errors_name_the_file_and_nothing_temporary() {
        let folder = tempfile::tempdir().expect("folder");
        std::fs::write(folder.path().join("none"), "").expect("a file");
        let missing = folder.path().join("none/a.png");
        for error in [check_writable(&missing), write(&missing, |_| Ok(()))] {
            let error = error.expect_err("no folder").to_string();
            assert!(error.starts_with(&missing.display().to_string()), "{error}");
            assert!(!error.replacen("/none/a.png", "", 1).contains("none"), "{error}");
        }
        let directory = check_writable(folder.path()).expect_err("a directory").to_string();
        assert!(directory.contains("it is a directory"), "{directory}");
    }
}
