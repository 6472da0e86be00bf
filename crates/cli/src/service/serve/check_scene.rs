//! `raystream check-scene`: reads a scene for the service, whose own process survives whatever happens here.

use crate::Outcome;
use crate::service::args::CheckSceneArgs;
use anyhow::{Context, Result};
use raystream::engine::PreparedScene;
use raystream::files;
use raystream::picture::{afford, scene_file, shaders};
use raystream::scene::flat::{self, FlatError};
use raystream::scene::load::{self, LoadOptions};
use raystream::scene::{ColourSpace, Scene, Wrap};
use std::path::Path;

/// Address space beside what a scene may take: the program, its threads' stacks, files that are mapped.
const BESIDE_BYTES: u64 = 2 << 30;

/// Reads the scene and prints the number of its triangles.
pub fn run(args: &CheckSceneArgs) -> Result<Outcome> {
    let memory = args.loading.memory.budget();
    limit_memory(memory.bytes())?;
    let options = args.loading.options().with_root(&args.root);
    let mut scene = scene_file::read(&args.scene, &options)?;
    // A scene that is kept is not tried again.
    check_pictures(args, &scene, &options)?;
    if let Some(path) = &args.flat {
        keep(&scene, path);
    }
    args.light.apply_environment(&mut scene, &options)?;
    scene.validate().with_context(|| Path::new(&args.scene).display().to_string())?;
    afford(&memory, "the scene and its tree".into(), PreparedScene::building_bytes(&scene))?;
    stdout_line!("{}", scene.mesh.triangles.len());
    Ok(Outcome::Done)
}

/// Reads the pictures that shaders of the job and of the scene look up, and lets go of them.
fn check_pictures(args: &CheckSceneArgs, scene: &Scene, options: &LoadOptions) -> Result<()> {
    let folder = args.scene.parent().unwrap_or(Path::new(""));
    let of_scene = shaders::pictures_of(scene).map(|picture| folder.join(picture.path));
    for path in args.picture.iter().cloned().chain(of_scene) {
        load::texture(&path, ColourSpace::Srgb, [Wrap::default(); 2], options)?;
    }
    Ok(())
}

/// Writes the loaded scene. Without the file it is loaded once more.
fn keep(scene: &Scene, path: &Path) {
    let written = files::write(path, |file| match flat::write(scene, file) {
        Err(FlatError::Io(error)) => Err(error),
        other => other.map_err(std::io::Error::other),
    });
    if let Err(error) = written {
        log::warn!("{error}");
    }
}

/// Lets the system give this process no more memory, whatever the scene makes it ask for.
fn limit_memory(bytes: u64) -> Result<()> {
    #[cfg(unix)]
    {
        use rustix::process::{Resource, Rlimit, setrlimit};
        let most = Some(bytes.saturating_mul(2).saturating_add(BESIDE_BYTES));
        let limit = Rlimit { current: most, maximum: most };
        setrlimit(Resource::As, limit).context("the memory of this process cannot be limited")?;
        let none = Rlimit { current: Some(0), maximum: Some(0) };
        setrlimit(Resource::Core, none).context("dumps of this process cannot be limited")?;
    }
    #[cfg(not(unix))]
    let _ = (bytes, BESIDE_BYTES);
    Ok(())
}
