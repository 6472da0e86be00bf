//! Finds and reads files by the names that scenes give them.

use super::{LoadOptions, LoadProblem, contents};
use std::borrow::Cow;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Resolves a name in `file` relative to the file's folder. Either slash separates folders.
pub(super) fn beside(file: &Path, name: &str) -> PathBuf {
    let name = name.replace('\\', "/");
    file.parent().unwrap_or(Path::new("")).join(name)
}

/// Reads the first `most` bytes of a file that a scene names. It must be a regular file: others may never end, or
/// wait for a writer.
pub(super) fn read(path: &Path, most: u64, options: &LoadOptions) -> Result<Vec<u8>, LoadProblem> {
    let cannot = |source| LoadProblem::Read { path: path.to_owned(), source };
    let about = std::fs::metadata(path).map_err(cannot)?;
    if !about.is_file() {
        let kind = if about.is_dir() { "a folder" } else { "a device or a pipe" };
        let problem = format!("{kind}; what a scene names must be a regular file");
        return Err(LoadProblem::File { path: path.to_owned(), problem });
    }
    contents(path, File::open(path).map_err(cannot)?, about.len(), most, options)
}

/// The file that an OBJ or MTL file names, or `None` if there is none. The name may be quoted, its blanks may be
/// escaped, a comment may follow it, and its letters may be of another case.
pub(super) fn file(named_in: &Path, name: &str) -> Option<PathBuf> {
    let bare = name.split_once(" #").map_or(name, |(bare, _)| bare).trim();
    let readings = [
        Cow::Borrowed(name),
        Cow::Borrowed(bare),
        Cow::Borrowed(bare.trim_matches('"')),
        Cow::Owned(bare.replace("\\ ", " ")),
    ];
    let paths = readings.map(|reading| beside(named_in, &reading));
    let is_there = |path: &&PathBuf| path.exists() && !path.is_dir();
    let found = paths.iter().find(is_there).cloned();
    found.or_else(|| paths.iter().find_map(|path| in_any_case(path).filter(|path| !path.is_dir())))
}

/// Folders of a name in which other cases of letters are looked for.
const MAX_FOLDERS: u32 = 16;

/// An existing path that differs from `path` at most in the case of letters.
pub(super) fn in_any_case(path: &Path) -> Option<PathBuf> {
    alike(path, MAX_FOLDERS)
}

fn alike(path: &Path, folders: u32) -> Option<PathBuf> {
    if path.exists() {
        return Some(path.to_owned());
    }
    let name = path.file_name()?.to_str()?.to_lowercase();
    let folder = match path.parent()? {
        here if here.as_os_str().is_empty() => PathBuf::from("."),
        folder => alike(folder, folders.checked_sub(1)?)?,
    };
    let entries = std::fs::read_dir(folder).ok()?.filter_map(Result::ok);
    let same =
        entries.filter(|entry| entry.file_name().to_str().is_some_and(|other| other.to_lowercase() == name));
    // The system lists files in any order.
    same.map(|entry| entry.path()).min()
}
