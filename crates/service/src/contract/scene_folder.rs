//! The folder of a scene's files, and the one that is the scene.

use super::names::inside;
use super::problem::Problem;
use axum::http::StatusCode;
use std::io;
use std::path::{Path, PathBuf};

/// The names of scene files by their extensions, in the order in which a pack is looked through.
const SCENES: [&str; 7] = ["json", "glb", "gltf", "obj", "ply", "stl", "off"];

/// The scene file of a scene's folder: the one that is named, or the only one.
///
/// # Errors
/// If there is none, or several and none is named.
pub fn entry_in(folder: &Path, name: Option<&str>) -> Result<PathBuf, Problem> {
    if let Some(name) = name {
        let path = inside(folder, name)
            .ok_or_else(|| Problem::unprocessable(format!("{name:?} does not lie in the pack")))?;
        let is_file = path.is_file();
        return is_file.then_some(path).ok_or_else(|| Problem::unprocessable(no_file(name)));
    }
    let mut found = Vec::new();
    scene_files(folder, &mut found).map_err(refused)?;
    for extension in SCENES {
        let mut of_kind = found.iter().filter(|path| has_extension(path, extension));
        match (of_kind.next(), of_kind.next()) {
            (Some(only), None) => return Ok(only.clone()),
            (Some(_), Some(_)) => {
                let detail = format!("the pack has several .{extension} files; name one as `entry`");
                return Err(Problem::unprocessable(detail));
            }
            _ => {}
        }
    }
    Err(Problem::unprocessable(format!("the pack has no scene: no file of {}", SCENES.join(", "))))
}

fn no_file(name: &str) -> String {
    format!("the pack has no file {name:?}")
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|own| own.eq_ignore_ascii_case(extension))
}

/// Collects the scene files of a folder and the folders in it.
fn scene_files(folder: &Path, found: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            scene_files(&path, found)?;
        } else if SCENES.iter().any(|extension| has_extension(&path, extension)) {
            found.push(path);
        }
    }
    Ok(())
}

/// The answer when the file system refuses.
pub fn refused(error: io::Error) -> Problem {
    let status = match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => StatusCode::INSUFFICIENT_STORAGE,
        _ => StatusCode::SERVICE_UNAVAILABLE,
    };
    Problem::new(status, format!("the data folder cannot be written: {error}; make space and try again"))
}
