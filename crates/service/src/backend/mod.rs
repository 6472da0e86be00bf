//! What renders the jobs of the service: specs are checked, scenes are read and kept ready.

mod disk_cache;
mod job_cost;
mod loaded_scenes;
mod memory_cache;
mod memory_pool;
mod open_job;
mod scene_reader;

pub use disk_cache::{Kept, shrink};
pub use job_cost::{FrameId, JobCost, StopRule};
pub use loaded_scenes::LoadedScenes;
pub use memory_cache::MemoryCache;
pub use open_job::{KeptScene, OpenJob};
pub use scene_reader::SceneReader;

use crate::contract::inside;
use anyhow::{Context, Result, anyhow, bail, ensure};
use glam::Vec3;
use memory_pool::{MemoryPool, MemoryShare};
use raystream::engine::{PreparedScene, Units};
use raystream::film::tev::Tev;
use raystream::memory::{MemoryBudget, OutOfMemory};
use raystream::picture::{
    CheckedSpec, Moving, Registry, RenderSpec, SceneSpec, SpecError, SpecGroup, TimedScene, afford,
    scene_file, shaders, with_causes,
};
use raystream::scene::{Camera, CameraError, Projection, Scene};
use raystream::schedule::{Policy, Service};
use serde_json::Value;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Jobs of the scheduler at the same time: units with their passes, and views.
pub const SCHEDULED: usize = 16;

/// How long a process that reads a scene is waited for between two looks.
const LOOK: Duration = Duration::from_millis(5);

/// Scenes that are read at the same time, as long as each takes no more than that part of what a scene may take.
const TOGETHER: u64 = 4;

/// Jobs that are kept ready, with their scenes.
const READY: u64 = 8;

/// How long a scene waits for memory that others hold.
const PATIENCE: Duration = Duration::from_secs(60);

/// Bytes that are kept of what a process says that reads a scene.
const TOLD: usize = 1 << 16;

/// Units, service and policy that all scenes of a process share.
#[derive(Clone, Debug)]
pub struct SharedUnits {
    /// The units that trace.
    pub units: Units,
    /// The service with its threads.
    pub service: Arc<Service>,
    /// The policy of its jobs.
    pub policy: Option<Policy>,
}

impl SharedUnits {
    /// The units, in words.
    pub fn in_words(&self) -> String {
        format!("{} threads ({})", self.service.host_threads(), self.units.simd())
    }
}

/// Checks render specs, reads their scenes and keeps them ready. Errors are sentences for whoever sent the request.
#[derive(Debug)]
pub struct RenderBackend {
    registry: Registry,
    units: SharedUnits,
    memory: MemoryBudget,
    /// Prepared scenes that may be needed again, by what they are made from.
    cache: MemoryCache<Arc<KeptScene>>,
    /// Jobs that may have another unit soon.
    jobs: MemoryCache<OpenJob>,
    /// Memory of all scenes together.
    pool: Arc<MemoryPool>,
    loaded: LoadedScenes,
    viewer: Option<Arc<Tev>>,
    is_ending: AtomicBool,
}

impl RenderBackend {
    /// A backend with these units, at most so many bytes for a scene and for those that are kept ready, at most twice
    /// as many for all scenes, those that are being read included, and a place for loaded scenes.
    pub fn new(registry: Registry, units: SharedUnits, memory: Option<u64>, loaded: LoadedScenes) -> Self {
        let memory = memory.unwrap_or_else(|| MemoryBudget::of_machine().bytes() / 2);
        let cache = MemoryCache::new(memory, |scene: &Arc<KeptScene>| weight(&scene.prepared));
        let (pool, memory) = (MemoryPool::new(memory.saturating_mul(2)), MemoryBudget::of_bytes(memory));
        let (jobs, is_ending) = (MemoryCache::new(READY, |_| 1), AtomicBool::new(false));
        Self { registry, units, memory, cache, jobs, pool, loaded, viewer: None, is_ending }
    }

    /// The same, whose pictures and views a viewer shows.
    pub fn with_viewer(self, viewer: Option<Arc<Tev>>) -> Self {
        Self { viewer, ..self }
    }

    /// The units that all scenes share.
    pub fn units(&self) -> &SharedUnits {
        &self.units
    }

    /// The registry of integrators and surfaces.
    pub fn registry(&self) -> &Registry {
        &self.registry
    }

    /// The scheduler that all jobs and views share.
    pub fn service(&self) -> &Arc<Service> {
        &self.units.service
    }

    /// Checks the spec of a job, whose files lie in `folder`, before its scene is read.
    fn checked(&self, spec: &RenderSpec, scene: &Path, folder: &Path) -> Result<CheckedSpec> {
        refuse_options_of_files(spec)?;
        let mut spec = spec.clone();
        confine(&mut spec, folder)?;
        spec.scene = Some(scene.to_owned());
        let checked = CheckedSpec::new(spec, &self.registry)?;
        checked.afford(&self.memory, 1)?;
        Ok(checked)
    }

    /// Checks the spec of a job before its scene is read. Files that it names lie in `folder`.
    ///
    /// # Errors
    /// What is wrong with an option.
    pub fn check(&self, spec: &RenderSpec, scene: &Path, folder: &Path) -> Result<JobCost, String> {
        check_camera(spec).map_err(|error| error.to_string())?;
        let checked = self.checked(spec, scene, folder).and_then(|checked| {
            checked.check_denoiser()?;
            Ok(JobCost::of(checked.spec()))
        });
        checked.map_err(|error| with_causes(&error))
    }

    /// Looks whether a scene can be read, in a process of its own whose memory and time are limited. Returns the number
    /// of its triangles.
    ///
    /// # Errors
    /// Why it cannot be read.
    pub fn try_scene(
        &self,
        spec: &RenderSpec,
        scene: &Path,
        folder: &Path,
        time: Duration,
    ) -> Result<u64, String> {
        let tried = self.checked(spec, scene, folder).and_then(|checked| {
            let spec = checked.spec();
            let flat = self.loaded.path(spec, folder);
            let has_images = spec.light.env_file().is_some() || pictures_of(spec).next().is_some();
            if let Some(triangles) = flat.as_ref().and_then(|flat| self.loaded.triangles(flat))
                && !has_images
            {
                return Ok(triangles);
            }
            self.loaded.make_room();
            let read = |memory| {
                let command = scene_reading(spec, folder, flat.as_deref(), memory)?;
                triangles_read(command, folder, time, &self.is_ending)
            };
            self.within_memory(read).map(|(triangles, _)| triangles)
        });
        tried.map_err(|error| with_causes(&error))
    }

    /// Ends the processes that read scenes, and those that would: the service ends.
    pub fn end(&self) {
        self.is_ending.store(true, Relaxed);
    }

    /// Reads the scene of a job that has been checked, or finds it in the cache.
    ///
    /// # Errors
    /// Why it cannot be read, or what options and scene have against each other.
    pub fn open(&self, spec: &RenderSpec, scene: &Path, folder: &Path) -> Result<OpenJob, String> {
        let key = format!("{} {}", scene.display(), spec.canonical());
        let open = || self.open_job(spec, scene, folder).map_err(|error| with_causes(&error));
        self.jobs.get(&key, open)
    }

    fn open_job(&self, spec: &RenderSpec, scene: &Path, folder: &Path) -> Result<OpenJob> {
        let checked = self.checked(spec, scene, folder)?;
        let key = SceneSpec::from(checked.spec()).key();
        let kept = self.cache.get(&key, || {
            let (prepared, mut share) =
                self.within_memory(|memory| self.prepare(&checked, folder, memory))?;
            share.shrink_to(weight(&prepared));
            Ok::<_, anyhow::Error>(Arc::new(KeptScene { prepared, _share: share }))
        })?;
        metrics::gauge!("raystream_scene_cache_bytes").set(self.cache.weight() as f64);
        let rendering = checked.rendering(kept.prepared.clone())?.with_policy(self.units.policy);
        let rendering = rendering.with_threads(self.service().host_threads());
        let options = checked.spec().loading.options(&self.memory).with_root(folder);
        let timed = TimedScene::new(&rendering, options.clone(), self.memory);
        let rendering = rendering.with_moving(|| Moving::new(options, self.memory));
        let job = OpenJob::new(rendering, Arc::clone(self.service()), self.viewer.clone(), kept);
        Ok(job.with_times(timed))
    }

    /// Reads a scene in a part of the memory, beside others; one that needs more, in all that a scene may take, with
    /// few others. Returns what was read, and the memory that it was read in.
    fn within_memory<T>(&self, read: impl Fn(MemoryBudget) -> Result<T>) -> Result<(T, MemoryShare)> {
        let take = |bytes| {
            let is_idle = |scene: &Arc<KeptScene>| Arc::strong_count(scene) == 1;
            let make_room = || self.jobs.let_go(OpenJob::is_idle) || self.cache.let_go(is_idle);
            self.pool.take(bytes, PATIENCE, &self.is_ending, make_room)
        };
        let (part, all) = (self.memory.bytes() / TOGETHER, self.memory.bytes());
        let share = take(part)?;
        match read(MemoryBudget::of_bytes(part)) {
            Err(error) if is_of_memory(&error) => {
                drop(share);
                let share = take(all)?;
                Ok((read(self.memory)?, share))
            }
            read => Ok((read?, share)),
        }
    }

    /// Reads a scene and prepares it.
    fn prepare(&self, checked: &CheckedSpec, folder: &Path, memory: MemoryBudget) -> Result<PreparedScene> {
        let spec = checked.spec();
        let options = spec.loading.options(&memory).with_root(folder);
        let path = self.loaded.path(spec, folder);
        let flat = path.map_or(Ok(None), |path| self.loaded.read(&path, &memory))?;
        let mut scene = match flat {
            Some(scene) => {
                scene_file::tell(&scene.warnings);
                scene
            }
            None => scene_file::read(checked.scene_file()?, &options)?,
        };
        refuse_foreign_shaders(&scene)?;
        // Shaders are part of the scene's hash, so they are not changed.
        let changed = checked.change(&mut scene, &options);
        changed.map_err(|error| match format!("{error:#}") {
            told if told.contains(&within(folder)) => anyhow!(without(folder, &told)),
            _ => error,
        })?;
        afford(&memory, "the scene and its tree".into(), PreparedScene::building_bytes(&scene))?;
        let prepared = PreparedScene::new(scene, &self.units.units)?;
        // All units have clones: what they need is computed once.
        prepared.lit();
        prepared.scene_hash();
        Ok(prepared)
    }

    /// The viewer that live views are shown in, too.
    pub fn viewer(&self) -> Option<Arc<Tev>> {
        self.viewer.clone()
    }

    /// Lets go of the scenes of a folder that are kept, and of their jobs: none of them will be asked for again.
    pub fn forget(&self, folder: &Path) {
        let start = format!("{}/", folder.display());
        self.jobs.forget(&start);
        self.cache.forget(&start);
    }
}

/// How paths within a folder begin.
fn within(folder: &Path) -> String {
    format!("{}/", folder.display())
}

/// An error that tells no one where the folder lies: paths within it are relative.
fn without(folder: &Path, error: &str) -> String {
    error.replace(&within(folder), "")
}

/// Bytes that a prepared scene takes.
fn weight(prepared: &PreparedScene) -> u64 {
    prepared.scene.bytes() + prepared.bvh.bytes() as u64
}

/// True if an error, here or in a process that reads a scene, is one of memory.
fn is_of_memory(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| cause.is::<OutOfMemory>() || cause.to_string().contains(" of memory"))
}

/// Refuses a field of view and a height that no camera can have, whatever the scene.
fn check_camera(spec: &RenderSpec) -> Result<(), CameraError> {
    let camera = Camera::new(Vec3::Z, Vec3::ZERO);
    let camera = spec.camera.fov.map_or(camera, |fov| camera.with_fov(fov));
    let projection = spec.optics.orthographic.map(|height| Projection::Orthographic { height });
    let camera = projection.map_or(camera, |projection| camera.with_projection(projection));
    camera.lens(spec.size.0, spec.size.1).map(drop)
}

/// Refuses options that say how files of the command line are split, named or laid out.
fn refuse_options_of_files(spec: &RenderSpec) -> Result<()> {
    if spec.part.samples.is_some() {
        bail!("samples: no option of a job; the service divides samples itself");
    }
    if spec.encoding.aov_format != raystream::film::LayerFormat::default() {
        bail!("aov-format: no option of a job; a job's layers are in its .exr and .npz");
    }
    Ok(())
}

/// Turns names of files into paths in the scene's folder.
fn confine(spec: &mut RenderSpec, folder: &Path) -> Result<()> {
    spec.scene = None;
    let mut refused = None;
    spec.map_files(|option, name| {
        let path = name.to_str().and_then(|name| inside(folder, name));
        match path {
            Some(path) if path.is_file() => return Ok::<_, SpecError>(path),
            Some(_) => refused = Some(format!("{option}: the pack has no file {:?}", name.display())),
            None => refused = Some(format!("{option}: {:?} does not lie in the pack", name.display())),
        }
        Ok(name.to_owned())
    })?;
    refused.map_or(Ok(()), |refused| bail!(refused))
}

/// Shaders of a scene, and their pictures, lie beside it or below.
fn refuse_foreign_shaders(scene: &Scene) -> Result<()> {
    for file in shaders::files_of(scene) {
        if file.to_str().and_then(|name| inside(Path::new(""), name)).is_none() {
            bail!("{:?}: a shader or a picture that a scene names lies beside it or below", file.display());
        }
    }
    Ok(())
}

/// The files of pictures that the shaders of a spec look up.
fn pictures_of(spec: &RenderSpec) -> impl Iterator<Item = PathBuf> {
    spec.surface.iter().flat_map(|surface| surface.pictures()).map(|picture| picture.path)
}

/// The process that reads a scene and writes it to a flat file.
fn scene_reading(
    spec: &RenderSpec,
    folder: &Path,
    flat: Option<&Path>,
    memory: MemoryBudget,
) -> Result<Command> {
    let mut command = Command::new(std::env::current_exe().context("this program has no file")?);
    command.arg("check-scene").arg("--root").arg(folder).args(["--memory", &memory.bytes().to_string()]);
    if let Some(flat) = flat {
        command.arg("--flat").arg(flat);
    }
    for (name, value) in spec.loading.entries(false) {
        command.arg(match value {
            Value::Bool(_) => format!("--{name}"),
            Value::String(text) => format!("--{name}={text}"),
            other => format!("--{name}={other}"),
        });
    }
    if let Some(env) = &spec.light.env {
        command.arg(format!("--env={env}"));
    }
    for picture in pictures_of(spec) {
        command.arg("--picture").arg(picture);
    }
    command.arg("--").arg(spec.scene.as_deref().unwrap_or(folder));
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    Ok(command)
}

/// Runs a process that reads a scene from `folder`, and prints the number of its triangles.
fn triangles_read(
    mut command: Command,
    folder: &Path,
    time: Duration,
    is_ending: &AtomicBool,
) -> Result<u64> {
    let mut child = command.spawn().context("no process can be started that reads the scene")?;
    // A process whose pipe is full waits for ever.
    let (printed, told) = (child.stdout.take().map(drain), child.stderr.take().map(drain));
    let began = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        let is_ending = is_ending.load(Relaxed);
        if is_ending || began.elapsed() > time {
            child.kill()?;
            child.wait()?;
            ensure!(!is_ending, "the service ends");
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
        Some(error) => bail!(without(folder, error)),
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

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// What becomes of a shell that is to print a number of triangles within so many milliseconds.
    fn read(script: &str, milliseconds: u64, is_ending: &AtomicBool) -> Result<u64> {
        let mut command = Command::new("sh");
        command.args(["-c", script]).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        triangles_read(command, Path::new("/scene"), Duration::from_millis(milliseconds), is_ending)
    }

    #[test]
    fn processes_that_read_scenes_end_with_their_time_and_with_the_service() {
        let goes_on = AtomicBool::new(false);
        assert_eq!(read("yes | head -c 1000000 >&2; echo 7", 60_000, &goes_on).ok(), Some(7));
        let told = |result: Result<u64>| result.expect_err("refused").to_string();
        assert_eq!(told(read("echo 'error: /scene/a.obj: no' >&2; exit 2", 60_000, &goes_on)), "a.obj: no");
        assert!(told(read("exec sleep 100", 20, &goes_on)).starts_with("load_time: "));
        let began = Instant::now();
        let ended = std::thread::scope(|scope| {
            scope.spawn(|| {
                std::thread::sleep(Duration::from_millis(50));
                goes_on.store(true, Relaxed);
            });
            told(read("exec sleep 100", 60_000, &goes_on))
        });
        assert!(ended == "the service ends" && began.elapsed() < Duration::from_secs(50), "{ended}");
    }
}
