//! A scene with its files as one upload, and the spec of a job.

use super::digits::hex;
use anyhow::{Context, Result};
use raystream::memory::MemoryBudget;
use raystream::picture::{CheckedSpec, Registry, RenderSpec, SpecError, scene_file, shaders};
use sha2::{Digest, Sha256};
use std::collections::BTreeSet;
use std::io::{Cursor, Write};
use std::path::{Component, Path, PathBuf};

/// A scene with its files, in the form in which scenes are uploaded.
#[derive(Clone, Debug)]
pub struct ScenePack {
    /// A scene file, or a zip archive.
    pub bytes: Vec<u8>,
    /// SHA-256 of the bytes.
    pub sha256: String,
    /// The scene file in an archive.
    pub entry: Option<String>,
}

/// An upload, and the spec of a job of it.
#[derive(Debug)]
pub struct Pack {
    /// The upload.
    pub scene: ScenePack,
    /// The spec, without the scene, whose files lie in the upload.
    pub spec: RenderSpec,
}

impl Pack {
    /// Checks a spec as `raystream render` does, reads its scene, and packs all files that both name.
    ///
    /// # Errors
    /// What is wrong with them, or the file that lies outside of the scene's folder.
    pub fn of(registry: &Registry, spec: &RenderSpec) -> Result<Self> {
        let checked = CheckedSpec::new(spec.clone(), registry)?;
        let scene = checked.scene_file()?;
        let read = scene_file::read(scene, &spec.loading.options(&MemoryBudget::of_machine()))?;
        let folder = scene.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."));
        let entry = inside(folder, scene)?;
        let mut files: BTreeSet<PathBuf> = BTreeSet::from([entry.clone()]);
        for file in &read.files {
            files.insert(inside(folder, file)?);
        }
        for file in shaders::files_of(&read) {
            files.insert(inside(folder, &folder.join(file))?);
        }
        let mut spec = RenderSpec::clone(spec);
        spec.scene = None;
        spec.map_files(|_, file| {
            let kept = inside(folder, file)?;
            let name = slashes(&kept)?;
            files.insert(kept);
            Ok::<_, PackError>(name.into())
        })?;
        let is_shader = |file: &&PathBuf| file.to_string_lossy().ends_with(shaders::EXTENSION);
        let imports = files.iter().filter(is_shader).map(|file| shaders::imports_of(&folder.join(file)));
        for import in imports.collect::<Result<Vec<_>>>()?.into_iter().flatten() {
            files.insert(inside(folder, &import)?);
        }
        let is_single = files.len() == 1 && has_own_format(&entry);
        let bytes = if is_single { std::fs::read(folder.join(&entry))? } else { zip(folder, &files)? };
        let sha256 = hex(&Sha256::digest(&bytes));
        let entry = if is_single { None } else { Some(slashes(&entry)?) };
        Ok(Self { scene: ScenePack { bytes, sha256, entry }, spec })
    }
}

/// Why a file cannot be packed.
#[derive(Debug, thiserror::Error)]
enum PackError {
    #[error(transparent)]
    Spec(#[from] SpecError),
    #[error("{0:#}")]
    File(#[from] anyhow::Error),
}

/// True if the service tells the format of the file from its content.
fn has_own_format(path: &Path) -> bool {
    let extension = path.extension().map(|extension| extension.to_ascii_lowercase());
    extension.is_some_and(|extension| ["glb", "gltf", "json", "ply"].iter().any(|own| extension == *own))
}

/// The path of a file within the scene's folder. A link has its own path and not that of its file: other files name it
/// so, and it may name files beside it.
fn inside(folder: &Path, file: &Path) -> Result<PathBuf> {
    let real =
        |path: &Path| path.canonicalize().with_context(|| format!("{}: cannot be read", path.display()));
    let (real_folder, path) = (real(folder)?, real(file)?);
    let kept = path.strip_prefix(&real_folder).with_context(|| {
        format!(
            "{}: it lies outside the scene's folder {}; move it there",
            file.display(),
            real_folder.display()
        )
    })?;
    let [folder, file] = [std::path::absolute(folder)?, std::path::absolute(file)?];
    let is_plain = |named: &&Path| named.components().all(|part| matches!(part, Component::Normal(_)));
    Ok(file.strip_prefix(folder).ok().filter(is_plain).unwrap_or(kept).to_owned())
}

/// A path with `/` between its folders.
fn slashes(path: &Path) -> Result<String> {
    let name = path.to_str().with_context(|| format!("{}: the name is not UTF-8", path.display()))?;
    Ok(name.replace(std::path::MAIN_SEPARATOR, "/"))
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

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn links_keep_their_paths_and_lead_to_nothing_outside() {
        let (work, other) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
        let folder = work.path().join("scene");
        std::fs::create_dir_all(folder.join("real/lib")).expect("folders");
        std::fs::write(folder.join("real/a.wgsl"), "").expect("a file");
        std::fs::write(other.path().join("b.wgsl"), "").expect("a file");
        for (target, link) in [
            (folder.join("real/a.wgsl"), folder.join("a.wgsl")),
            (folder.join("real"), folder.join("linked")),
            (other.path().join("b.wgsl"), folder.join("b.wgsl")),
            (folder.clone(), work.path().join("same")),
        ] {
            symlink(target, link).expect("a link");
        }
        for (file, expected) in [
            ("scene/a.wgsl", "a.wgsl"),
            ("scene/linked/a.wgsl", "linked/a.wgsl"),
            ("scene/linked/lib/../a.wgsl", "real/a.wgsl"),
            ("same/real/a.wgsl", "real/a.wgsl"),
        ] {
            assert_eq!(inside(&folder, &work.path().join(file)).expect(file), Path::new(expected), "{file}");
        }
        let error = inside(&folder, &folder.join("b.wgsl")).expect_err("outside");
        assert!(error.to_string().contains("it lies outside the scene's folder"), "{error}");
    }
}
