//! Scenes on the disk, by the SHA-256 of what was uploaded, and the files of jobs. With a storage, they are copies of
//! what lies there (`copies.rs`).

use super::ledger::LedgerError;
use super::storage::Storage;
use crate::contract::{Limits, Problem, entry_in, failpoint, hex, inside, refused};
use axum::http::StatusCode;
use raystream::files::sync_folder;
use sha2::{Digest, Sha256};
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// The folder that files of the service lie in.
#[derive(Debug)]
pub struct Store {
    data: PathBuf,
    /// Held while a scene's folder comes or goes together with its row of the ledger.
    pub(super) scenes: Mutex<()>,
    storage: Option<Storage>,
    /// When scenes of the storage were last used, or came.
    pub(super) used: Mutex<HashMap<String, Instant>>,
    /// Held while a scene comes back from the storage.
    pub(super) restoring: Mutex<()>,
}

/// An upload whose bytes come one after another.
#[derive(Debug)]
pub struct Upload {
    file: tempfile::NamedTempFile,
    hash: Sha256,
    bytes: u64,
}

impl Upload {
    /// Adds bytes.
    ///
    /// # Errors
    /// If the disk refuses them.
    pub fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.hash.update(bytes);
        self.bytes += bytes.len() as u64;
        self.file.write_all(bytes)
    }

    /// The number of bytes so far.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// A scene of one request, which is not kept.
#[derive(Debug)]
pub struct Passing {
    folder: tempfile::TempDir,
    path: PathBuf,
    sha256: String,
}

impl Passing {
    /// Its file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The folder that holds nothing else.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Its SHA-256 in hexadecimal digits.
    pub fn sha256(&self) -> &str {
        &self.sha256
    }
}

impl Store {
    /// The folders of a data folder, which hold copies of the storage's objects; what an earlier process left
    /// half-written is removed.
    ///
    /// # Errors
    /// If the folders cannot be made.
    pub fn open(data: &Path, storage: Option<Storage>) -> io::Result<Self> {
        let (scenes, used, restoring) = (Mutex::default(), Mutex::default(), Mutex::default());
        let store = Self { data: data.to_owned(), scenes, storage, used, restoring };
        if store.temporary().exists() {
            std::fs::remove_dir_all(store.temporary())?;
        }
        for folder in [store.temporary(), data.join("scenes"), data.join("jobs")] {
            std::fs::create_dir_all(folder)?;
        }
        sync_folder(data)?;
        Ok(store)
    }

    /// The folder of all.
    pub fn data(&self) -> &Path {
        &self.data
    }

    /// Where finished pictures and uploaded scenes lie, if that is not the data folder alone.
    pub fn storage(&self) -> Option<&Storage> {
        self.storage.as_ref()
    }

    /// The folder of what is not whole yet.
    pub fn temporary(&self) -> PathBuf {
        self.data.join("temporary")
    }

    /// The folder of a scene's files. Nothing in it is a link.
    pub fn scene_folder(&self, sha256: &str) -> PathBuf {
        self.data.join("scenes").join(sha256)
    }

    /// The folder of a job's films and pictures.
    pub fn job_folder(&self, job: &str) -> PathBuf {
        self.data.join("jobs").join(job)
    }

    /// Begins an upload.
    ///
    /// # Errors
    /// If no file can be made.
    pub fn begin(&self) -> io::Result<Upload> {
        let file = tempfile::NamedTempFile::new_in(self.temporary())?;
        Ok(Upload { file, hash: Sha256::new(), bytes: 0 })
    }

    /// Keeps an upload whose hash is right. A pack is unpacked first. When the scene is on the disk, and in the storage
    /// if there is one, `note` writes it down with the number of bytes: no one removes it meanwhile.
    ///
    /// # Errors
    /// If the hash is another, the pack is damaged or too large, or the disk or the storage refuses; those of `note`.
    pub fn keep(
        &self,
        upload: Upload,
        sha256: &str,
        limits: &Limits,
        note: impl FnOnce(u64) -> Result<(), LedgerError>,
    ) -> Result<u64, Problem> {
        let Upload { file, hash, bytes } = upload;
        let found = hex(&hash.finalize());
        if found != sha256 {
            let detail = format!("the body's SHA-256 is {found}, not that of the address; upload it again");
            return Err(Problem::unprocessable(detail));
        }
        let mut file = file.into_file();
        let folder = self.unpacked(&mut file, limits)?;
        if self.storage.is_some() {
            self.used
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .insert(sha256.to_owned(), Instant::now());
        }
        self.put_scene(sha256, &mut file, bytes)?;
        failpoint::pass("scene-stored");
        self.place_scene(folder.path(), sha256, || {
            // It may have been removed while it came.
            self.put_scene(sha256, &mut file, bytes)?;
            Ok(note(bytes)?)
        })?;
        Ok(bytes)
    }

    /// Moves the files of a scene to where they belong, and writes that down. No scene comes or goes meanwhile.
    pub(super) fn place_scene(
        &self,
        folder: &Path,
        sha256: &str,
        note: impl FnOnce() -> Result<(), Problem>,
    ) -> Result<(), Problem> {
        let _held = self.scenes.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = self.scene_folder(sha256);
        // Another upload of the same bytes may have been faster.
        if !kept.exists() {
            let renamed = std::fs::rename(folder, &kept);
            renamed.or_else(|error| if kept.exists() { Ok(()) } else { Err(error) }).map_err(refused)?;
        }
        sync_folder(&self.data.join("scenes")).map_err(refused)?;
        note()
    }

    /// Writes the files of a scene into a folder of their own.
    pub(super) fn unpacked(&self, file: &mut File, limits: &Limits) -> Result<tempfile::TempDir, Problem> {
        let folder = tempfile::tempdir_in(self.temporary()).map_err(refused)?;
        file.rewind().map_err(refused)?;
        let mut start = Vec::new();
        Read::by_ref(file).take(512).read_to_end(&mut start).map_err(refused)?;
        file.rewind().map_err(refused)?;
        if start.starts_with(b"PK\x03\x04") {
            unpack(file.try_clone().map_err(refused)?, folder.path(), limits)?;
        } else {
            let extension = kind(&start).ok_or_else(|| {
                let detail = "the body is neither a GLB, a recipe, nor a zip archive of a scene's files";
                Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, detail)
            })?;
            // A recipe, or a glTF file whose buffers are data.
            let is_gltf = extension == "json" && is_gltf(file).map_err(refused)?;
            let extension = if is_gltf { "gltf" } else { extension };
            let path = folder.path().join("scene").with_extension(extension);
            let mut kept = File::create(path).map_err(refused)?;
            io::copy(file, &mut kept).and_then(|_| kept.sync_all()).map_err(refused)?;
        }
        sync_folder(folder.path()).map_err(refused)?;
        Ok(folder)
    }

    /// Removes a folder: first it leaves its place, whole, then its files go.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn discard(&self, folder: &Path) -> io::Result<()> {
        let away = tempfile::tempdir_in(self.temporary())?;
        match std::fs::rename(folder, away.path().join("gone")) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
            moved => moved?,
        }
        sync_folder(folder.parent().unwrap_or(&self.data))?;
        failpoint::pass("folder-moved");
        away.close()
    }

    /// Moves an upload of one glTF file into a folder of its own, which is removed with the value.
    ///
    /// # Errors
    /// If the disk refuses.
    pub fn pass(&self, upload: Upload) -> io::Result<Passing> {
        let Upload { mut file, hash, .. } = upload;
        let mut start = Vec::new();
        file.rewind()?;
        file.as_file().take(4).read_to_end(&mut start)?;
        let folder = tempfile::tempdir_in(self.temporary())?;
        let extension = if start == b"glTF" { "glb" } else { "gltf" };
        let path = folder.path().join("scene").with_extension(extension);
        file.persist(&path)?;
        Ok(Passing { folder, path, sha256: hex(&hash.finalize()) })
    }

    /// The scene file of a pack: the one that is named, or the only one.
    ///
    /// # Errors
    /// If there is none, or several and none is named; if the storage refuses.
    pub fn entry(&self, sha256: &str, name: Option<&str>) -> Result<PathBuf, Problem> {
        self.present(sha256)?;
        entry_in(&self.scene_folder(sha256), name)
    }
}

/// What a file is by its first bytes, if it needs no other files.
fn kind(start: &[u8]) -> Option<&'static str> {
    if start.starts_with(b"glTF") {
        return Some("glb");
    }
    if start.starts_with(b"ply") {
        return Some("ply");
    }
    start.trim_ascii_start().starts_with(b"{").then_some("json")
}

/// Whether JSON is a glTF file: it says so anywhere, since its members may have any order. Damaged files are recipes.
fn is_gltf(file: &mut File) -> io::Result<bool> {
    #[derive(serde::Deserialize)]
    struct Top {
        asset: Option<serde::de::IgnoredAny>,
    }
    let top: Result<Top, _> = serde_json::from_reader(io::BufReader::new(&mut *file));
    file.rewind()?;
    Ok(top.is_ok_and(|top| top.asset.is_some()))
}

/// Writes the files of a zip archive into a folder. Bytes are counted as they are decompressed.
fn unpack(pack: File, folder: &Path, limits: &Limits) -> Result<(), Problem> {
    let damaged =
        |error: zip::result::ZipError| Problem::unprocessable(format!("the pack is damaged: {error}"));
    let too_large = |name: &str, limit: u64, detail: &str| {
        Problem::limit(StatusCode::PAYLOAD_TOO_LARGE, name, limit, format!("{detail}; make the pack smaller"))
    };
    let mut archive = zip::ZipArchive::new(pack).map_err(damaged)?;
    if archive.len() > limits.pack_files {
        let most = limits.pack_files as u64;
        return Err(too_large("pack_files", most, &format!("a pack has at most {most} files")));
    }
    let mut left = limits.unpacked_bytes;
    for index in 0..archive.len() {
        let entry = archive.by_index(index).map_err(damaged)?;
        let name = entry.name().map_err(damaged)?.into_owned();
        let outside = || Problem::unprocessable(format!("the pack names {name:?}, which lies outside of it"));
        let path = inside(folder, &name).ok_or_else(outside)?;
        if entry.is_dir() {
            std::fs::create_dir_all(&path).map_err(refused)?;
            continue;
        }
        if entry.is_symlink() {
            let detail = format!("the pack holds the link {name:?}; put the file itself into it");
            return Err(Problem::unprocessable(detail));
        }
        let parent = path.parent().unwrap_or(folder);
        let clash = |_| Problem::unprocessable(format!("the pack has two things of the name {name:?}"));
        std::fs::create_dir_all(parent).map_err(clash)?;
        let mut file = File::create_new(&path).map_err(clash)?;
        // One byte more shows that there is more.
        let copied = io::copy(&mut entry.take(left + 1), &mut file);
        let copied = copied.map_err(|error| Problem::unprocessable(format!("{name}: {error}")))?;
        left = left.checked_sub(copied).ok_or_else(|| {
            let most = limits.unpacked_bytes;
            too_large("unpacked_bytes", most, &format!("the files of a pack have at most {most} bytes"))
        })?;
        file.sync_all().map_err(refused)?;
        sync_folder(parent).map_err(refused)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use zip::write::SimpleFileOptions;

    fn pack(files: &[(&str, &[u8])]) -> Vec<u8> {
        let mut zip = zip::ZipWriter::new(io::Cursor::new(Vec::new()));
        for (name, bytes) in files {
            let options = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
            zip.start_file(*name, options).expect("a file");
            zip.write_all(bytes).expect("bytes");
        }
        zip.finish().expect("an archive").into_inner()
    }

    fn keep(store: &Store, bytes: &[u8], limits: &Limits) -> Result<String, Problem> {
        let sha256 = hex(&Sha256::digest(bytes));
        let mut upload = store.begin().expect("an upload");
        upload.write(bytes).expect("a disk");
        store.keep(upload, &sha256, limits, |_| Ok(())).map(|_| sha256)
    }

    #[test]
    fn packs_hold_their_files_and_nothing_leads_out_of_them() {
        let folder = tempfile::tempdir().expect("a folder");
        let store = Store::open(folder.path(), None).expect("a store");
        let limits = Limits { unpacked_bytes: 1000, pack_files: 3, ..Limits::default() };
        let good = pack(&[("a/scene.obj", b"v 0 0 0"), ("a/scene.mtl", b"")]);
        let sha256 = keep(&store, &good, &limits).expect("a pack");
        assert_eq!(keep(&store, &good, &limits).expect("again"), sha256);
        let entry = store.entry(&sha256, None).expect("one scene");
        assert_eq!(std::fs::read(entry).expect("its file"), b"v 0 0 0");
        for bad in ["../../token", "/etc/passwd", "..", "", "a/../../x"] {
            assert!(store.entry(&sha256, Some(bad)).is_err(), "{bad}");
        }
        let zeros = vec![0; 100_000];
        for (files, status) in [
            (&[("../out.obj", &b"x"[..])][..], 422),
            (&[("/tmp/out.obj", b"x")], 422),
            (&[("a", b"x"), ("a/b", b"x")], 422),
            (&[("bomb.obj", &zeros[..])], 413),
            (&[("1", b""), ("2", b""), ("3", b""), ("4", b"")], 413),
        ] {
            let problem = keep(&store, &pack(files), &limits).expect_err("refused");
            assert_eq!(problem.status().as_u16(), status, "{problem:?}");
        }
        let gltf = format!("{{ \"accessors\": [{:>900}], \"asset\": {{}} }}", 0);
        for (bytes, extension) in [(&*gltf, "gltf"), ("{ \"shapes\": [] }", "json"), ("{ damaged", "json")] {
            let sha256 = keep(&store, bytes.as_bytes(), &limits).expect("a file");
            let entry = store.entry(&sha256, None).expect("one scene");
            assert!(entry.extension().is_some_and(|own| own.eq_ignore_ascii_case(extension)), "{bytes}");
        }
        assert_eq!(keep(&store, b"MZ", &limits).expect_err("no scene").status().as_u16(), 415);
        let left = std::fs::read_dir(store.temporary()).expect("a folder").count();
        assert_eq!(left, 0, "nothing is left of what was refused");
        let upload = store.begin().expect("an upload");
        assert_eq!(
            store.keep(upload, &sha256, &limits, |_| Ok(())).expect_err("another").status().as_u16(),
            422
        );
    }
}
