//! `raystream bench`.

mod adaptive;
mod build;
mod frame;
mod latency;
#[cfg(feature = "serve")]
mod live;
mod noise;
mod peers;
mod rays;
mod schedule;
mod shaders;
mod small;
mod tables;
mod tail;
mod textures;

use super::Outcome;
use super::args::{BenchCommand, SceneArgs, ShotArgs};
use super::outputs::Outputs;
use super::setup::Setup;
use super::stats::{self, SCHEMA};
use crate::engine::Units;
use crate::meters::processor;
use crate::scene::{Camera, Scene};
use anyhow::Result;
use serde::Serialize;
use std::path::Path;

/// Runs a measurement.
pub fn run(command: &BenchCommand) -> Result<Outcome> {
    let scenes = command.scenes().into_iter().map(|scene| ("the scene", Some(scene)));
    Outputs::check([("--json", command.json())], scenes)?;
    match command {
        BenchCommand::Rays(args) => rays::run(args).map(|()| Outcome::Done),
        BenchCommand::Build(args) => build::run(args).map(|()| Outcome::Done),
        BenchCommand::Small(args) => small::run(args).map(|()| Outcome::Done),
        BenchCommand::Frame(args) => frame::run(args),
        BenchCommand::Tail(args) => tail::run(args).map(|()| Outcome::Done),
        BenchCommand::Textures(args) => textures::run(args).map(|()| Outcome::Done),
        BenchCommand::Shaders(args) => shaders::run(args).map(|()| Outcome::Done),
        BenchCommand::Adaptive(args) => adaptive::run(args).map(|()| Outcome::Done),
        BenchCommand::Noise(args) => noise::run(args).map(|()| Outcome::Done),
        BenchCommand::Latency(args) => latency::run(args).map(|()| Outcome::Done),
        #[cfg(feature = "serve")]
        BenchCommand::Live(args) => live::run(args).map(|()| Outcome::Done),
        #[cfg(not(feature = "serve"))]
        BenchCommand::Live(_) => {
            anyhow::bail!("this build was made without the live view: build it with --features serve")
        }
        BenchCommand::Schedule(args) => schedule::run(args).map(|()| Outcome::Done),
        BenchCommand::Tables(args) => tables::run(args).map(|()| Outcome::Done),
    }
}

impl ShotArgs {
    /// Prepares a scene and a service for `max_jobs` jobs at a time; returns them with the scene's camera.
    fn set_up(&self, scene: &Path, (width, height): (u32, u32), max_jobs: usize) -> Result<(Setup, Camera)> {
        let loading = SceneArgs::default();
        let light = |scene: &mut Scene| self.light.apply_environment(scene, &loading.options());
        let setup = Setup::new(scene, &loading, 0, &self.units, max_jobs, light)?;
        let scene = &setup.prepared.scene;
        let framed = || Camera::framing(&scene.bounds(), width as f32 / height as f32);
        let camera = self.camera.apply(scene.camera, framed);
        Ok((setup, camera))
    }
}

/// What every file of `--json` begins with.
#[derive(Serialize)]
struct Provenance {
    schema: u32,
    /// This process's arguments, without its name.
    command: Vec<String>,
    machine: Machine,
}

#[derive(Serialize)]
struct Machine {
    /// [`processor`].
    processor: Option<String>,
    /// That the system offers.
    threads: usize,
    simd: &'static str,
}

impl Provenance {
    fn here() -> Self {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let machine = Machine { processor: processor(), threads, simd: Units::cpu().simd().name() };
        let command =
            std::env::args_os().skip(1).map(|argument| argument.to_string_lossy().into_owned()).collect();
        Self { schema: SCHEMA, command, machine }
    }
}

/// A row with its scene.
#[derive(Serialize)]
struct SceneRow<'a, R> {
    #[serde(skip_serializing_if = "Option::is_none")]
    scene: Option<&'a str>,
    #[serde(flatten)]
    row: &'a R,
}

impl<'a, R> SceneRow<'a, R> {
    fn all(scene: Option<&'a str>, rows: &'a [R]) -> impl Iterator<Item = Self> {
        rows.iter().map(move |row| Self { scene, row })
    }
}

/// What `--json` writes.
#[derive(Serialize)]
struct Sheet<'a, R> {
    #[serde(flatten)]
    provenance: Provenance,
    rows: Vec<SceneRow<'a, R>>,
}

/// Writes the rows of a measurement to the file of `--json`, if there is one.
fn write<R: Serialize>(path: Option<&Path>, scene: Option<&Path>, rows: &[R]) -> Result<()> {
    let Some(path) = path else { return Ok(()) };
    let scene = scene.map(|path| path.file_name().and_then(|name| name.to_str()).unwrap_or_default());
    let rows = SceneRow::all(scene, rows).collect();
    stats::write(path, &Sheet { provenance: Provenance::here(), rows })
}
