//! A scene with its files as one upload, and the options of a job.

use super::options::{ALLOWED, told};
use crate::cli::args::{Cli, Command, RenderArgs};
use crate::cli::render::views;
use crate::cli::{Registry, scene_file};
use crate::serve::{ScenePack, hex};
use anyhow::{Context, Result, anyhow, bail};
use clap::parser::ValueSource;
use clap::{ArgAction, ArgMatches, FromArgMatches};
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

/// What is sent for a scene and options.
pub struct Pack {
    pub scene: ScenePack,
    pub options: Map<String, Value>,
}

impl Pack {
    /// Reads a scene, checks options as `raystream render` does, and packs all files that both name.
    pub fn of(registry: &Registry, scene: &Path, options: &[String]) -> Result<Self> {
        let command = registry.command();
        let first = ["raystream".into(), "render".into(), scene.as_os_str().to_owned()];
        let all: Vec<OsString> = first.into_iter().chain(options.iter().map(OsString::from)).collect();
        let matches = command.clone().try_get_matches_from(all).map_err(|error| anyhow!(told(&error)))?;
        let render = command.find_subcommand("render").context("there is the command `render`")?;
        let given = matches.subcommand().context("the command is `render`")?.1;
        let mut options = given_options(render, given)?;
        let Command::Render(args) = Cli::from_arg_matches(&matches)?.command else {
            bail!("the options are those of `raystream render`")
        };
        let read = scene_file::read(scene, &args.loading)?;
        let folder = scene.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."));
        let folder = folder.canonicalize().with_context(|| scene.display().to_string())?;
        let mut files: BTreeSet<PathBuf> = BTreeSet::from([inside(&folder, scene)?]);
        for file in &read.files {
            files.insert(inside(&folder, file)?);
        }
        for request in read.surface_requests.iter().filter(|request| request.surface.ends_with(".wgsl")) {
            files.insert(inside(&folder, &folder.join(&request.surface))?);
        }
        for (option, file) in files_of(&args) {
            let kept = inside(&folder, &file)?;
            rename(&mut options, option, &file, &kept)?;
            files.insert(kept);
        }
        let entry = inside(&folder, scene)?;
        let is_single = files.len() == 1 && has_own_format(&entry);
        let bytes = if is_single { std::fs::read(folder.join(&entry))? } else { zip(&folder, &files)? };
        let sha256 = hex(&Sha256::digest(&bytes));
        let entry = if is_single { None } else { Some(slashes(&entry)?) };
        Ok(Self { scene: ScenePack { bytes, sha256, entry }, options })
    }
}

/// Whether the service tells the format of the file from its content.
fn has_own_format(path: &Path) -> bool {
    let extension = path.extension().map(|extension| extension.to_ascii_lowercase());
    extension.is_some_and(|extension| ["glb", "gltf", "json", "ply"].iter().any(|own| extension == *own))
}

/// The path of a file within the scene's folder.
fn inside(folder: &Path, file: &Path) -> Result<PathBuf> {
    let path = file.canonicalize().with_context(|| format!("{}: cannot be read", file.display()))?;
    let inside = path.strip_prefix(folder).with_context(|| {
        format!("{}: it lies outside the scene's folder {}; move it there", file.display(), folder.display())
    })?;
    Ok(inside.to_owned())
}

/// A path with `/` between its folders.
fn slashes(path: &Path) -> Result<String> {
    let name = path.to_str().with_context(|| format!("{}: the name is not UTF-8", path.display()))?;
    Ok(name.replace(std::path::MAIN_SEPARATOR, "/"))
}

/// Options that name files, and the files.
fn files_of(args: &RenderArgs) -> Vec<(&'static str, PathBuf)> {
    let matrix = args.optics.world_to_camera.as_deref();
    let matrix = matrix.filter(|text| text.split(',').any(|number| number.trim().parse::<f64>().is_err()));
    let single = [
        ("env", args.light.env_file()),
        ("camera-path", args.animation.camera_path.as_deref()),
        ("views", views::file(args)),
        ("world-to-camera", matrix.map(Path::new)),
    ];
    let single = single.into_iter().filter_map(|(option, file)| Some((option, file?.to_owned())));
    single.chain(args.surface.iter().map(|surface| ("surface", surface.file.clone()))).collect()
}

/// Puts the name in the pack in place of a file's name in an option.
fn rename(options: &mut Map<String, Value>, option: &str, file: &Path, kept: &Path) -> Result<()> {
    let (from, to) = (file.display().to_string(), slashes(kept)?);
    let renamed = |value: &Value| Value::String(value.as_str().unwrap_or_default().replacen(&from, &to, 1));
    if let Some(value) = options.get_mut(option) {
        *value = match &*value {
            Value::Array(values) => Value::Array(values.iter().map(renamed).collect()),
            one => renamed(one),
        };
    }
    Ok(())
}

/// The options that a command line gives, by their long names.
fn given_options(render: &clap::Command, given: &ArgMatches) -> Result<Map<String, Value>> {
    let mut options = Map::new();
    for arg in render.get_arguments().filter(|arg| !arg.is_positional()) {
        let (id, Some(long)) = (arg.get_id().as_str(), arg.get_long()) else { continue };
        if long == "help" || given.value_source(id) != Some(ValueSource::CommandLine) {
            continue;
        }
        if !ALLOWED.contains(&long) {
            bail!("--{long} is no option of a job; it may have --{}", ALLOWED.join(", --"));
        }
        let texts: Vec<Value> = given
            .get_raw(id)
            .into_iter()
            .flatten()
            .map(|raw| raw.to_str().map(Value::from).ok_or_else(|| anyhow!("--{long}: not UTF-8")))
            .collect::<Result<_>>()?;
        let value = match arg.get_action() {
            action if !action.takes_values() => Value::Bool(true),
            ArgAction::Append => Value::Array(texts),
            _ => texts.into_iter().next_back().unwrap_or_default(),
        };
        options.insert(long.to_owned(), value);
    }
    Ok(options)
}

/// A zip archive of files. The same files give the same bytes.
fn zip(folder: &Path, files: &BTreeSet<PathBuf>) -> Result<Vec<u8>> {
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default()
        .compression_method(zip::CompressionMethod::Deflated)
        .last_modified_time(zip::DateTime::default())
        .large_file(true);
    for file in files {
        let path = folder.join(file);
        archive.start_file(slashes(file)?, options)?;
        archive.write_all(&std::fs::read(&path).with_context(|| path.display().to_string())?)?;
    }
    Ok(archive.finish()?.into_inner())
}
