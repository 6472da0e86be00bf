//! Files of a frame: the films of its units, then its pictures.

use crate::files::{self, NotWritten};
use crate::render::PartialFilm;
use std::io::Write;
use std::path::Path;

/// What the names of films begin with; the first sample follows.
pub const FILM: &str = "samples-";

/// The name of pictures without their extension.
pub const PICTURE: &str = "picture";

/// Writes a film. It is on the disk before it has its name.
pub(super) fn write_film(path: &Path, film: &PartialFilm) -> Result<(), NotWritten> {
    files::write(path, |file| {
        film.write(&mut *file)?;
        file.flush()?;
        file.get_ref().sync_all()
    })
}

/// Removes a file that is of no use any more, if it is there.
pub(super) fn remove(path: &Path) {
    if let Err(error) = std::fs::remove_file(path)
        && error.kind() != std::io::ErrorKind::NotFound
    {
        log::warn!("{}: cannot be removed: {error}", path.display());
    }
}
