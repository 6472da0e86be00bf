//! A folder for the files of one test.

use raystream::scene::Scene;
use raystream::scene::load::{LoadError, LoadOptions, load_with};
use std::path::PathBuf;

/// Gone when dropped.
pub struct Folder(tempfile::TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        // Some file systems wait for the disk when a file is truncated, not when it is made anew.
        _ = std::fs::remove_file(&path);
        std::fs::write(&path, bytes).expect("a temporary file");
        path
    }

    /// An image of these RGBA texels; its kind is that of the name.
    pub fn image(&self, name: &str, width: u32, texels: &[[u8; 4]]) -> PathBuf {
        let image = image::RgbaImage::from_raw(width, texels.len() as u32 / width, texels.concat());
        let path = self.path(name);
        image.expect("enough texels").save(&path).expect("a temporary image");
        path
    }

    pub fn load(&self, name: &str) -> Result<Scene, LoadError> {
        self.load_with(name, &LoadOptions::default())
    }

    pub fn load_with(&self, name: &str, options: &LoadOptions) -> Result<Scene, LoadError> {
        load_with(self.path(name), options)
    }

    pub fn scene(&self, name: &str) -> Scene {
        self.load(name).unwrap_or_else(|error| panic!("{error}"))
    }

    /// The message that loading fails with; it names the file.
    pub fn message(&self, name: &str) -> String {
        let message = self.load(name).err().unwrap_or_else(|| panic!("{name} loads")).to_string();
        assert!(message.contains(&*self.0.path().to_string_lossy()), "names no file: {message}");
        message
    }
}

/// Whether some warning holds all of `parts`.
pub fn warns(scene: &Scene, parts: &[&str]) -> bool {
    scene.warnings.iter().any(|warning| parts.iter().all(|part| warning.contains(part)))
}

/// Asserts that a text holds all of `parts`.
#[track_caller]
pub fn assert_holds(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "{part:?} is not in {text:?}");
    }
}
