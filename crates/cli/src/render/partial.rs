//! Writes partial films.

use super::insist;
use anyhow::{Context, Result};
use raystream::files::{self, NotWritten};
use raystream::picture::{AnyIntegrator, Rendering};
use raystream::render::{Integrator, PartialFilm, Progressive};
use raystream::scene::Camera;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

/// Writes a finished part to a file, if one is given. Returns why it is not written if the part is not finished.
pub fn write_finished(
    path: Option<&Path>,
    rendering: &Rendering,
    camera: &Camera,
    frame: &Progressive<AnyIntegrator>,
    facts: &BTreeMap<String, String>,
) -> Result<Option<String>> {
    let Some(path) = path else { return Ok(None) };
    let name = path.display();
    if !frame.is_complete() {
        return Ok(Some(format!("{name}: not written, because not all of its samples have been taken")));
    }
    let part = frame.integrator().frame();
    let identity = rendering.whole_identity(Some(camera));
    let film = PartialFilm::new(identity, part, frame.picture()).with_context(|| name.to_string())?;
    let film = film.with_metadata(facts.clone());
    insist(|| write(path, &film))?;
    Ok(None)
}

/// Writes a partial film. After a crash the file is either the previous one or this one.
pub fn write(path: &Path, film: &PartialFilm) -> Result<(), NotWritten> {
    files::write(path, |file| {
        film.write(&mut *file)?;
        file.flush()?;
        file.get_ref().sync_all()
    })
}
