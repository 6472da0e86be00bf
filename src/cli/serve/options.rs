//! Options of jobs: those of `raystream render`, within the folder of a scene.

use crate::cli::args::{Cli, Command, RenderArgs};
use crate::cli::options_file::of_options;
use crate::cli::render::animation::Animation;
use crate::cli::render::{check_options, picture_bytes, views};
use crate::cli::{Registry, plugin_options::Setting};
use crate::memory::MemoryBudget;
use crate::serve::{Demand, Kind, inside};
use anyhow::{Context, Result, anyhow, bail};
use clap::FromArgMatches;
use serde_json::{Map, Value};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// The options that a job may have: none that names outputs, units or limits of the service.
pub const ALLOWED: &[&str] = &[
    "K",
    "allow-missing",
    "aov",
    "aperture-blades",
    "aperture-radius",
    "aperture-rotation",
    "camera",
    "camera-path",
    "clamp-indirect",
    "distortion",
    "env",
    "env-rotation",
    "exposure",
    "exr-compression",
    "exr-half",
    "eye",
    "f-stop",
    "filter",
    "fisheye",
    "focus-distance",
    "fov",
    "fps",
    "frames",
    "integrator",
    "max-bounces",
    "no-russian-roulette",
    "noise",
    "orthographic",
    "panorama",
    "png-bits",
    "region",
    "seconds",
    "seed",
    "set",
    "shift",
    "size",
    "spp",
    "surface",
    "target",
    "transparent",
    "turntable",
    "up",
    "variant",
    "view",
    "views",
    "white-balance",
    "world-to-camera",
];

/// A job's options, checked.
pub struct Parsed {
    pub args: RenderArgs,
    /// Settings of the integrator and of surfaces of the registry.
    pub own: Vec<Setting>,
    /// Settings of shaders.
    pub foreign: Vec<Setting>,
}

/// Checks options, as the command line does.
pub fn parse(
    registry: &Registry,
    command: &clap::Command,
    options: &Map<String, Value>,
    scene: &Path,
    folder: &Path,
    memory: MemoryBudget,
) -> Result<Parsed> {
    if let Some(key) = options.keys().find(|key| !ALLOWED.contains(&&***key)) {
        bail!("{key:?} is no option of a job; it may have {}", ALLOWED.join(", "));
    }
    let render = command.find_subcommand("render").context("there is the command `render`")?;
    let tokens = of_options(render, options).map_err(|error| anyhow!(error))?;
    let first = ["raystream", "render"].map(OsString::from);
    let all = first.into_iter().chain(tokens).chain(["--".into(), scene.into()]);
    let matches = command.clone().try_get_matches_from(all);
    let cli =
        matches.and_then(|matches| Cli::from_arg_matches(&matches)).map_err(|error| anyhow!(told(&error)))?;
    let Command::Render(args) = cli.command else { bail!("the options are those of `raystream render`") };
    let mut args = *args;
    args.loading.memory = Some(memory.bytes());
    args.loading.root = Some(folder.to_owned());
    if args.animation.frames.is_some() || args.optics.has_several() {
        args.output = Some("%04d.png".into());
    }
    confine(&mut args, folder)?;
    let (width, height) = args.size;
    let bytes = picture_bytes(width, height, &args.aovs(), args.progress.samples());
    args.loading.afford(format!("a picture of {width}x{height} pixels"), bytes)?;
    Animation::check(&args)?;
    let (own, foreign) = check_options(&args, registry)?;
    Ok(Parsed { args, own, foreign })
}

/// What clap says of a wrong option, without hints for terminals.
pub fn told(error: &clap::Error) -> String {
    let text = error.render().to_string();
    let end = text.find("\n\nUsage").or_else(|| text.find("\n\nFor more")).unwrap_or(text.len());
    text[..end].trim_start_matches("error: ").trim().replace('\n', " ")
}

/// Turns names of files into paths in the scene's folder.
fn confine(args: &mut RenderArgs, folder: &Path) -> Result<()> {
    let lead = |option: &str, name: &Path| -> Result<PathBuf> {
        let path = name.to_str().and_then(|name| inside(folder, name));
        let path =
            path.with_context(|| format!("{option}: {:?} does not lie in the pack", name.display()))?;
        if !path.is_file() {
            bail!("{option}: the pack has no file {:?}", name.display());
        }
        Ok(path)
    };
    let text =
        |path: PathBuf| path.into_os_string().into_string().map_err(|_| anyhow!("a path is not UTF-8"));
    if let Some(file) = args.light.env_file() {
        args.light.env = Some(text(lead("env", file)?)?);
    }
    if let Some(file) = &args.animation.camera_path {
        args.animation.camera_path = Some(lead("camera-path", file)?);
    }
    if let Some(file) = views::file(args) {
        args.optics.views = Some(text(lead("views", file)?)?);
    }
    if let Some(matrix) = &args.optics.world_to_camera
        && matrix.split(',').any(|number| number.trim().parse::<f64>().is_err())
    {
        args.optics.world_to_camera = Some(text(lead("world-to-camera", Path::new(matrix))?)?);
    }
    for surface in &mut args.surface {
        surface.file = lead("surface", &surface.file)?;
    }
    Ok(())
}

impl Parsed {
    /// What the job asks for.
    pub fn demand(&self) -> Demand {
        let args = &self.args;
        let views = args.optics.views.as_deref().map(str::parse::<u32>);
        let frames = match (&args.animation.frames, views) {
            (Some(frames), _) => Some(frames.end - frames.start),
            (None, Some(Ok(count))) => Some(count),
            (None, None) if !args.optics.is_all() => Some(1),
            _ => None,
        };
        let kind = match (args.progress.seconds, args.progress.noise) {
            (Some(_), _) => Kind::Seconds,
            (None, Some(_)) => Kind::Noise,
            (None, None) => Kind::Samples,
        };
        Demand::new(args.size, args.progress.samples(), frames, kind)
    }
}
