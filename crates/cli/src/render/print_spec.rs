//! `raystream render --print-spec`.

use crate::Outcome;
use crate::args::RenderArgs;
use anyhow::{Context, Result};
use raystream::picture::{CheckedSpec, Registry, SpecError};
use std::path::Path;

/// Prints the render spec as JSON. Its files are named relative to the current folder, where the output belongs; those
/// outside are named in full, and told.
pub fn run(args: &RenderArgs, registry: &Registry) -> Result<Outcome> {
    let mut spec = CheckedSpec::new((*args.spec).clone(), registry)?.spec().clone();
    let folder = std::env::current_dir().context("there is no current folder")?;
    spec.map_files(|option, file| {
        let whole = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
        let whole = whole.canonicalize().unwrap_or(whole);
        if file == Path::new("-") {
            log::warn!("{option}: standard input cannot be named in a spec");
            return Ok(file.to_owned());
        }
        match whole.strip_prefix(&folder) {
            Ok(inside) => Ok::<_, SpecError>(inside.to_owned()),
            Err(_) => {
                log::warn!("{option}: {} lies outside of this folder", whole.display());
                Ok(whole)
            }
        }
    })?;
    stdout_line!("{}", serde_json::to_string_pretty(&spec)?);
    Ok(Outcome::Done)
}
