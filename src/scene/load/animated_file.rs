//! A file that is read once, whose scene is shown at many times.

use super::kind::Kind;
use super::session::Session;
use super::textures::Images;
use super::{LoadError, LoadOptions, LoadProblem, finished, gltf, loaded};
use crate::scene::Scene;
use std::fmt;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A glTF file that has been read, with its buffers and the images that have been decoded: what else a scene at a time
/// needs is its pose.
///
/// ```no_run
/// use raystream::scene::load::{AnimatedFile, LoadOptions, load_with};
///
/// let (path, options) = ("fox.glb".as_ref(), LoadOptions::default());
/// let fox = AnimatedFile::read(path, &options)?;
/// for frame in 0..48 {
///     let seconds = f64::from(frame) / 24.0;
///     let still = load_with(path, &options.clone().with_time(seconds))?;
///     assert_eq!(fox.at(seconds)?.fingerprint(), still.fingerprint());
/// }
/// # Ok::<(), raystream::scene::load::LoadError>(())
/// ```
pub struct AnimatedFile {
    file: gltf::File,
    /// The session that the file was read in.
    session: Session,
    images: Mutex<Images>,
}

impl AnimatedFile {
    /// Reads a file. Its images are decoded when they are first needed.
    ///
    /// # Errors
    /// When it is no glTF file, and as for [`super::load_with`].
    pub fn read(path: &Path, options: &LoadOptions) -> Result<Self, LoadError> {
        let mut session = Session::new(path, options);
        let file = match Kind::of_name(path) {
            Some(Kind::Gltf) => gltf::File::read(&mut session),
            _ => Err(LoadProblem::File {
                path: path.to_owned(),
                problem: "only glTF files are animated".into(),
            }),
        };
        match file {
            Ok(file) => Ok(Self { file, session, images: Mutex::default() }),
            Err(problem) => Err(LoadError::new(problem, session.warnings.into_list())),
        }
    }

    /// The scene at a time in seconds: what [`super::load_with`] makes of the file with the options and this time.
    ///
    /// # Errors
    /// As for [`super::load_with`].
    pub fn at(&self, seconds: f64) -> Result<Scene, LoadError> {
        let mut session = self.session.clone();
        session.options = session.options.with_time(seconds);
        let mut images = self.images().clone();
        let scene = self.file.scene(&mut session, &mut images);
        let scene = scene.and_then(|scene| finished(scene, &session, &mut images.mipmaps));
        if scene.is_ok() {
            *self.images() = images;
        }
        loaded(scene, session)
    }

    /// Bytes that are kept: buffers, and images without their mipmap levels, which are those of the scenes.
    pub fn bytes(&self) -> u64 {
        self.file.bytes() + self.images().bytes()
    }

    fn images(&self) -> MutexGuard<'_, Images> {
        self.images.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl fmt::Debug for AnimatedFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("AnimatedFile")
            .field("path", &self.session.path)
            .field("bytes", &self.bytes())
            .finish()
    }
}
