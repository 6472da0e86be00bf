//! What renders the jobs of the service: the command line's own code.

use super::loaded::LoadedScenes;
use super::options::{self, Parsed};
use super::pack::Pack;
use super::shots::Scene;
use crate::cli::args::{ServeArgs, UnitArgs, viewer};
use crate::cli::render::apply_surfaces;
use crate::cli::setup::SharedUnits;
use crate::cli::{Registry, scene_file, with_causes};
use crate::engine::PreparedScene;
use crate::film::tev::Tev;
use crate::memory::MemoryBudget;
use crate::schedule::Service;
use crate::serve::{Demand, Pictures, SceneCache, ScenePack, Shots};
use anyhow::{Context, Result, bail};
use serde_json::{Map, Value};
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Jobs of the scheduler at the same time: units with their passes, and views.
const SCHEDULED: usize = 16;

/// The options that decide what a prepared scene is.
const OF_SCENE: &[&str] =
    &["allow-missing", "env", "env-rotation", "integrator", "set", "surface", "variant"];

/// How long a process that reads a scene is waited for between two looks.
const LOOK: Duration = Duration::from_millis(5);

/// Bytes that are kept of what a process says that reads a scene.
const TOLD: usize = 1 << 16;

/// Checks and renders with the options of `raystream render`.
pub struct Studio {
    registry: Arc<Registry>,
    command: clap::Command,
    units: SharedUnits,
    memory: MemoryBudget,
    cache: SceneCache,
    loaded: LoadedScenes,
    viewer: Option<Arc<Tev>>,
}

impl Studio {
    /// Opens the units and starts the threads.
    pub fn open(registry: Registry, args: &ServeArgs) -> Result<Self> {
        let loaded = LoadedScenes::new(&args.data, args.max_unpacked);
        let own = Self::with_units(registry, &args.units, args.memory, loaded)?;
        Ok(Self { viewer: args.tev.as_deref().map(viewer).transpose()?.map(Arc::new), ..own })
    }

    /// The same with these units, at most so many bytes for a scene and for those that are kept ready, and a place for
    /// loaded scenes. No viewer shows the pictures.
    pub fn with_units(
        registry: Registry,
        units: &UnitArgs,
        memory: Option<u64>,
        loaded: LoadedScenes,
    ) -> Result<Self> {
        let half = || MemoryBudget::of_machine().bytes() / 2;
        let memory = memory.unwrap_or_else(half);
        Ok(Self {
            command: registry.command(),
            registry: Arc::new(registry),
            units: SharedUnits::open(units, SCHEDULED)?,
            memory: MemoryBudget::of_bytes(memory),
            cache: SceneCache::new(memory),
            loaded,
            viewer: None,
        })
    }

    /// What traces, in words.
    #[cfg(feature = "farm")]
    pub fn units_in_words(&self) -> String {
        self.units.in_words()
    }

    fn parse(&self, options: &Map<String, Value>, scene: &Path, folder: &Path) -> Result<Parsed> {
        options::parse(&self.registry, &self.command, options, scene, folder, self.memory)
    }

    /// A scene with its files, in the form in which scenes are uploaded.
    pub fn pack(&self, scene: &Path) -> Result<ScenePack> {
        Ok(Pack::of(&self.registry, scene, &[])?.scene)
    }

    /// Reads a scene and prepares it.
    fn prepare(&self, parsed: &Parsed, folder: &Path) -> Result<PreparedScene> {
        let Parsed { args, own, foreign } = parsed;
        let path = self.loaded.path(parsed, folder);
        let mut scene = match path.and_then(|path| self.loaded.read(&path, &args.loading.memory())) {
            Some(scene) => {
                scene_file::tell(&scene.warnings);
                scene
            }
            None => scene_file::read(&args.scene, &args.loading)?,
        };
        refuse_foreign_shaders(&scene)?;
        // Shaders are part of the scene's hash, so they are not changed.
        drop(apply_surfaces(args, &self.registry, &mut scene, own, foreign)?);
        args.light.apply_environment(&mut scene, &args.loading.options())?;
        args.loading.afford("the scene and its tree".into(), PreparedScene::building_bytes(&scene))?;
        let prepared = PreparedScene::new(scene, &self.units.units)?;
        // All units have clones: what they need is computed once.
        prepared.lit();
        prepared.scene_hash();
        Ok(prepared)
    }

    fn open_job(&self, options: &Map<String, Value>, scene: &Path, folder: &Path) -> Result<Box<dyn Shots>> {
        let parsed = self.parse(options, scene, folder)?;
        let of_scene: Map<String, Value> = options
            .iter()
            .filter(|(key, _)| OF_SCENE.contains(&&***key))
            .map(|(key, value)| (key.clone(), value.clone()))
            .collect();
        let key = format!("{} {}", scene.display(), Value::Object(of_scene));
        let prepared = self.cache.get(&key, || self.prepare(&parsed, folder))?;
        let scene = Scene::new(parsed, &prepared, Arc::clone(&self.registry), self.units.clone())?;
        Ok(Box::new(scene.shown_by(self.viewer.clone())))
    }
}

/// Shaders of a scene lie beside it or below.
fn refuse_foreign_shaders(scene: &crate::scene::Scene) -> Result<()> {
    for request in scene.surface_requests.iter().filter(|request| request.surface.ends_with(".wgsl")) {
        if crate::serve::inside(Path::new(""), &request.surface).is_none() {
            bail!("{:?}: a shader that a scene names lies beside it or below", request.surface);
        }
    }
    Ok(())
}

/// Runs a process that reads a scene and writes it to a flat file. Returns the number of triangles that it prints.
fn try_scene(
    parsed: &Parsed,
    folder: &Path,
    flat: Option<&Path>,
    memory: MemoryBudget,
    time: Duration,
) -> Result<u64> {
    let args = &parsed.args;
    let mut command = Command::new(std::env::current_exe().context("this program has no file")?);
    command.arg("check-scene").arg("--root").arg(folder).args(["--memory", &memory.bytes().to_string()]);
    if let Some(flat) = flat {
        command.arg("--flat").arg(flat);
    }
    if args.loading.allow_missing {
        command.arg("--allow-missing");
    }
    if let Some(variant) = &args.loading.variant {
        command.arg(format!("--variant={variant}"));
    }
    if let Some(env) = &args.light.env {
        command.arg(format!("--env={env}"));
    }
    command.arg("--").arg(&args.scene);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().context("no process can be started that reads the scene")?;
    // A process whose pipe is full waits for ever.
    let (printed, told) = (child.stdout.take().map(drain), child.stderr.take().map(drain));
    let began = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        if began.elapsed() > time {
            child.kill()?;
            child.wait()?;
            bail!("load_time: reading the scene took more than {} s, which is the limit", time.as_secs());
        }
        std::thread::sleep(LOOK);
    };
    let text = |pipe: Option<JoinHandle<String>>| pipe.and_then(|pipe| pipe.join().ok()).unwrap_or_default();
    let (printed, told) = (text(printed), text(told));
    if status.success() {
        return printed.trim().parse().context("the process that reads the scene prints no number");
    }
    match told.lines().rev().find_map(|line| line.strip_prefix("error: ")) {
        Some(error) => bail!("{}", error.replace(&format!("{}/", folder.display()), "")),
        None => bail!("the process that reads the scene ended with {status}; the service goes on"),
    }
}

/// Reads a pipe to its end in a thread of its own; keeps the last part, which tells what went wrong.
fn drain(mut pipe: impl Read + Send + 'static) -> JoinHandle<String> {
    std::thread::spawn(move || {
        let (mut kept, mut buffer) = (Vec::new(), [0; 1 << 13]);
        while let Ok(read) = pipe.read(&mut buffer)
            && read > 0
        {
            kept.extend_from_slice(&buffer[..read]);
            if kept.len() > 2 * TOLD {
                kept.drain(..kept.len() - TOLD);
            }
        }
        String::from_utf8_lossy(&kept).into_owned()
    })
}

impl Pictures for Studio {
    fn service(&self) -> &Arc<Service> {
        &self.units.service
    }

    fn check(&self, options: &Map<String, Value>, scene: &Path, folder: &Path) -> Result<Demand, String> {
        let parsed = self.parse(options, scene, folder);
        parsed.map(|parsed| parsed.demand()).map_err(|error| with_causes(&error))
    }

    fn try_scene(
        &self,
        options: &Map<String, Value>,
        scene: &Path,
        folder: &Path,
        time: Duration,
    ) -> Result<u64, String> {
        let tried = self.parse(options, scene, folder).and_then(|parsed| {
            let flat = self.loaded.path(&parsed, folder);
            let has_map = parsed.args.light.env_file().is_some();
            if let Some(triangles) = flat.as_ref().and_then(|flat| self.loaded.triangles(flat))
                && !has_map
            {
                return Ok(triangles);
            }
            self.loaded.make_room();
            try_scene(&parsed, folder, flat.as_deref(), self.memory, time)
        });
        tried.map_err(|error| with_causes(&error))
    }

    fn open(
        &self,
        options: &Map<String, Value>,
        scene: &Path,
        folder: &Path,
    ) -> Result<Box<dyn Shots>, String> {
        self.open_job(options, scene, folder).map_err(|error| with_causes(&error))
    }

    fn viewer(&self) -> Option<Arc<Tev>> {
        self.viewer.clone()
    }

    fn forget(&self, folder: &Path) {
        self.cache.forget(&format!("{}/", folder.display()));
    }
}
