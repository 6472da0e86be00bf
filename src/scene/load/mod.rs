//! Loads scene files: Wavefront OBJ with MTL, glTF 2.0 and GLB, PLY, STL, OFF, and recipes ([`super::recipe`],
//! `.json`). Also loads equirectangular `.hdr` and `.exr` images as [`EnvironmentMap`](super::EnvironmentMap).
//!
//! A loader returns either a scene that satisfies all invariants of [`Scene`], or one error that names the file and
//! the place in it. An optional feature that is not supported becomes a sentence in [`Scene::warnings`]. Primitive ids
//! follow the order of the faces in the file. Polygons become fans around their first corner. Faces with a vertex that
//! is not finite are dropped, with a warning. Points and lines of glTF files, and the vertices of PLY files without
//! faces, become balls and tubes. No input makes a loader panic, or take more memory than [`LoadOptions::with_memory`]
//! allows: large things are counted before they are allocated. The file that the caller names may be a pipe; what a
//! scene names must be a regular file.
//!
//! With the feature `meshes` alone OBJ, PLY, STL and OFF are read, for ray queries as well: an OBJ file without its
//! materials, and no images.
//!
//! ```
//! use raystream::query;
//! use raystream::scene::load;
//!
//! # let folder = std::env::temp_dir().join(format!("raystream-load-{}", std::process::id()));
//! # std::fs::create_dir_all(&folder)?;
//! # let path = folder.join("triangle.obj");
//! # std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")?;
//! let scene = load::load(&path)?;
//! let mesh = query::Mesh::build(&scene.mesh.positions, &scene.mesh.triangles)?;
//! assert!(mesh.occluded_one(&query::Ray::new([0.2, 0.2, 1.0], [0.0, 0.0, -1.0])));
//! # std::fs::remove_dir_all(&folder)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#[cfg(feature = "formats")]
mod animated_file;
#[cfg(feature = "formats")]
mod decode;
mod dropped;
#[cfg(feature = "formats")]
mod environment;
mod error;
#[cfg(feature = "formats")]
mod gltf;
#[cfg(feature = "formats")]
mod guard;
mod kind;
#[cfg(feature = "formats")]
mod ktx2;
#[cfg(feature = "formats")]
mod named;
mod obj;
mod off;
mod options;
mod plain;
mod ply;
#[cfg(feature = "formats")]
mod recipe;
mod session;
mod stl;
mod strokes;
#[cfg(feature = "formats")]
mod texture;
#[cfg(feature = "formats")]
mod textures;
mod warnings;

#[cfg(feature = "formats")]
pub use self::{
    animated_file::AnimatedFile,
    environment::{LARGEST_RADIANCE, OVERFLOWED_RADIANCE, environment, environment_with},
    texture::texture,
};
pub use error::{LoadError, LoadProblem};
pub use options::LoadOptions;
pub use plain::scene_of_mesh;

use super::Scene;
use super::mip_weights::Mipmaps;
use crate::memory::OutOfMemory;
use kind::Kind;
#[cfg(unix)]
use rayon::prelude::*;
use session::Session;
use std::fs::File;
use std::io::Read;
#[cfg(unix)]
use std::os::unix::fs::FileExt;
use std::path::Path;

/// [`load_with`] with the default options.
///
/// # Errors
/// As for [`load_with`].
pub fn load(path: impl AsRef<Path>) -> Result<Scene, LoadError> {
    load_with(path, &LoadOptions::default())
}

/// Loads a scene. The extension of the file name (`.obj`, `.gltf`, `.glb`, `.ply`, `.stl`, `.off`, `.json`, in any
/// case) selects the loader.
///
/// # Errors
/// When the file, or a file that it names, cannot be read or does not follow its format, requires a feature that is
/// not supported, contains no triangles, or needs more memory than the options allow.
pub fn load_with(path: impl AsRef<Path>, options: &LoadOptions) -> Result<Scene, LoadError> {
    let path = path.as_ref();
    let mut session = Session::new(path, options);
    let kind = Kind::of_name(path);
    let kind = kind.ok_or_else(|| LoadProblem::Kind { path: path.to_owned(), expected: Kind::EXTENSIONS });
    let scene = kind.and_then(|kind| scene(&mut session, kind));
    loaded(scene, session)
}

/// Loads a scene from a stream, standard input for example. The content tells what it is: GLB, glTF, PLY, STL, OFF or a
/// recipe. OBJ cannot be told by its content. `path` names the stream in messages, and files that the scene names are
/// looked for beside it; it need not exist.
///
/// ```
/// use raystream::scene::load::{LoadOptions, load_from};
///
/// let triangle = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
/// let scene = load_from(triangle.as_bytes(), "a triangle".as_ref(), &LoadOptions::default())?;
/// assert_eq!(scene.mesh.triangles, [[0, 1, 2]]);
/// # Ok::<(), raystream::scene::load::LoadError>(())
/// ```
///
/// # Errors
/// As for [`load_with`], and if the content is none of these.
pub fn load_from(stream: impl Read, path: &Path, options: &LoadOptions) -> Result<Scene, LoadError> {
    let mut session = Session::new(path, options);
    let scene = contents(path, stream, 0, u64::MAX, options).and_then(|bytes| {
        let Some(kind) = Kind::of_content(&bytes) else {
            let problem =
                "the content is none of GLB, glTF, PLY, STL, OFF or a recipe; an OBJ file must be named";
            return Err(LoadProblem::File { path: path.to_owned(), problem: problem.into() });
        };
        session.given = Some(bytes);
        scene(&mut session, kind)
    });
    loaded(scene, session)
}

/// The scene with what the session took note of, or the error with its warnings.
fn loaded(scene: Result<Scene, LoadProblem>, session: Session) -> Result<Scene, LoadError> {
    match scene {
        Ok(scene) => Ok(Scene { warnings: session.warnings.into_list(), files: session.files, ..scene }),
        Err(problem) => Err(LoadError::new(problem, session.warnings.into_list())),
    }
}

fn scene(session: &mut Session, kind: Kind) -> Result<Scene, LoadProblem> {
    let path = session.path.clone();
    if let Some(name) = session.options.variant.clone().filter(|_| kind != Kind::Gltf) {
        return Err(LoadProblem::Variant { path, name, known: Vec::new() });
    }
    let scene = match kind {
        Kind::Obj => obj::load(session),
        #[cfg(feature = "formats")]
        Kind::Gltf => gltf::load(session),
        Kind::Ply => ply::load(session),
        Kind::Stl => stl::load(session),
        Kind::Off => off::load(session),
        #[cfg(feature = "formats")]
        Kind::Recipe => recipe::load(session),
        #[cfg(not(feature = "formats"))]
        Kind::Gltf | Kind::Recipe => Err(LoadProblem::File {
            path: path.clone(),
            problem:
                "this build reads OBJ, PLY, STL and OFF alone; glTF and recipes need the feature `formats`"
                    .into(),
        }),
    }?;
    finished(scene, session, &mut Mipmaps::default())
}

/// A scene that a loader has made, once it has been checked, with its mipmap levels. Those that are missing are added
/// to `mipmaps`.
fn finished(mut scene: Scene, session: &Session, mipmaps: &mut Mipmaps) -> Result<Scene, LoadProblem> {
    let path = session.path.clone();
    if scene.mesh.triangles.is_empty() {
        return Err(LoadProblem::Empty { path, reasons: session.warnings.list().to_vec() });
    }
    let valid = scene.mesh.validate(scene.materials.len());
    valid.map_err(|source| LoadProblem::Mesh { path, source })?;
    // Levels are computed from sums that take as much memory again.
    let largest = scene.textures.iter().map(|texture| 11 * texture.image().len() as u64).max().unwrap_or(0);
    let fits = session.check("the mipmaps of the textures", scene.mipmap_bytes() + largest);
    fits.map_err(|source| session.over(source))?;
    scene.take_mipmaps(mipmaps);
    Ok(scene)
}

/// The extension of a file name in lower case. Empty if there is none.
fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

/// Quotes a word of a file for a message: escaped, and cut after 60 characters.
fn quote(text: &str) -> String {
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{:?}...", &text[..end]),
        None => format!("{text:?}"),
    }
}

/// Reads the file that the caller names, which may be a pipe.
fn read(path: &Path, options: &LoadOptions) -> Result<Vec<u8>, LoadProblem> {
    let cannot = |source| LoadProblem::Read { path: path.to_owned(), source };
    let file = File::open(path).map_err(cannot)?;
    let about = file.metadata().map_err(cannot)?;
    #[cfg(unix)]
    if about.is_file() && options.memory.check("the file", about.len()).is_ok() {
        // Whatever is wrong is told below.
        if let Some(bytes) = read_by_all(&file, about.len()) {
            return Ok(bytes);
        }
    }
    contents(path, file, about.len(), u64::MAX, options)
}

/// Reads a large file, which the threads of rayon's pool share: most of the time goes into memory that is new. `None`
/// if it is small, cannot be read or changes its size meanwhile.
#[cfg(unix)]
fn read_by_all(file: &File, length: u64) -> Option<Vec<u8>> {
    const PART: usize = 1 << 21;
    let length = usize::try_from(length).ok().filter(|length| *length > 2 * PART)?;
    let mut bytes: Vec<u8> = bytemuck::allocation::try_zeroed_vec(length).ok()?;
    let parts = bytes.par_chunks_mut(PART).enumerate();
    parts.try_for_each(|(part, bytes)| file.read_exact_at(bytes, (part * PART) as u64)).ok()?;
    (file.metadata().ok()?.len() == length as u64).then_some(bytes)
}

/// The first `most` bytes of a file of `length` bytes, as far as the system knows.
fn contents(
    path: &Path,
    file: impl Read,
    length: u64,
    most: u64,
    options: &LoadOptions,
) -> Result<Vec<u8>, LoadProblem> {
    let over = |source| LoadProblem::Memory { path: path.to_owned(), source };
    let allowed = options.memory.bytes();
    options.memory.check("the file", length.min(most)).map_err(over)?;
    let mut bytes = Vec::new();
    let needed = length.min(most).min(allowed);
    if bytes.try_reserve_exact(needed as usize).is_err() {
        return Err(over(OutOfMemory::Refused { what: "the file".into(), needed }));
    }
    // A pipe has no length, and a file may have grown.
    let read = file.take(most.min(allowed.saturating_add(1))).read_to_end(&mut bytes);
    read.map_err(|source| LoadProblem::Read { path: path.to_owned(), source })?;
    options.memory.check("the file", bytes.len() as u64).map_err(over)?;
    Ok(bytes)
}

/// Refuses what only looks like the text of a scene by its name, as a failed download does.
fn check_text(path: &Path, bytes: &[u8]) -> Result<(), LoadProblem> {
    let text = bytes.trim_ascii_start();
    let problem = if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        "the text is encoded as UTF-16; save it as UTF-8"
    } else if text.starts_with(b"<") {
        "this is HTML or XML, not a scene; a download may have failed"
    } else {
        return Ok(());
    };
    Err(LoadProblem::File { path: path.to_owned(), problem: problem.into() })
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn large_files_are_read_by_all_threads() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("file");
        let bytes: Vec<u8> = (0..5_000_001_u32).map(|i| crate::geom::mix(i) as u8).collect();
        for (length, is_large) in [(0, false), (1 << 22, false), (bytes.len(), true)] {
            std::fs::write(&path, &bytes[..length]).expect("written");
            let file = File::open(&path).expect("there");
            assert_eq!(read_by_all(&file, length as u64).is_some(), is_large);
            assert!(read_by_all(&file, length as u64 + 1).is_none(), "a file that has become shorter");
            let read = read(&path, &LoadOptions::default()).expect("readable");
            assert!(read == bytes[..length], "{length} bytes");
        }
    }
}
