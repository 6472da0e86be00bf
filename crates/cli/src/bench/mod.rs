//! `raystream bench`.

mod adaptive;
mod build;
mod frame;
mod gpu;
mod latency;
mod noise;
mod peers;
mod povray;
#[cfg_attr(not(feature = "gpu"), path = "no_raster.rs")]
mod raster;
mod rays;
mod schedule;
mod shaders;
mod small;
mod tables;
mod tail;
mod textures;

use super::Outcome;
use super::args::{BenchCommand, MemoryArgs, ShotArgs};
use super::outputs::Outputs;
use super::service::bench_live;
use super::setup::{Setup, Work};
use super::sheet::{Provenance, SceneRow, write};
use anyhow::{Error, Result, bail};
use raystream::engine::{PreparedScene, Units};
use raystream::picture::LoadingSpec;
use raystream::scene::{Camera, Scene, generate};
use std::path::Path;

/// A scene whose units are all ready.
fn open(scene: &Path, units: &Units) -> Result<PreparedScene> {
    let prepared = PreparedScene::new(generate::scene(scene)?, units)?;
    if let Some(reason) = &prepared.degraded {
        bail!("{reason}");
    }
    prepared.wait_for_device().map_err(Error::msg)?;
    Ok(prepared)
}

/// Runs a measurement.
pub fn run(command: &BenchCommand) -> Result<Outcome> {
    let scenes = command.scenes().into_iter().map(|scene| ("the scene", Some(scene)));
    Outputs::check([("--json", command.json())], scenes)?.make_folders()?;
    match command {
        BenchCommand::Rays(args) => rays::run(args).map(|()| Outcome::Done),
        BenchCommand::Gpu(args) => gpu::run(args).map(|()| Outcome::Done),
        BenchCommand::Build(args) => build::run(args).map(|()| Outcome::Done),
        BenchCommand::Small(args) => small::run(args).map(|()| Outcome::Done),
        BenchCommand::Frame(args) => frame::run(args),
        BenchCommand::Tail(args) => tail::run(args).map(|()| Outcome::Done),
        BenchCommand::Textures(args) => textures::run(args).map(|()| Outcome::Done),
        BenchCommand::Shaders(args) => shaders::run(args).map(|()| Outcome::Done),
        BenchCommand::Adaptive(args) => adaptive::run(args).map(|()| Outcome::Done),
        BenchCommand::Noise(args) => noise::run(args).map(|()| Outcome::Done),
        BenchCommand::Latency(args) => latency::run(args).map(|()| Outcome::Done),
        BenchCommand::Live(args) => bench_live(args).map(|()| Outcome::Done),
        BenchCommand::Schedule(args) => schedule::run(args).map(|()| Outcome::Done),
        BenchCommand::Tables(args) => tables::run(args).map(|()| Outcome::Done),
        BenchCommand::Povray(args) => povray::run(args).map(|()| Outcome::Done),
        BenchCommand::Raster(args) => raster::run(args).map(|()| Outcome::Done),
    }
}

impl ShotArgs {
    /// Prepares a scene and a service for `max_jobs` jobs at a time; returns them with the scene's camera.
    pub fn set_up(
        &self,
        scene: &Path,
        (width, height): (u32, u32),
        max_jobs: usize,
    ) -> Result<(Setup, Camera)> {
        let (loading, memory) = (LoadingSpec::default(), MemoryArgs::default().budget());
        let options = loading.options(&memory);
        let light = |scene: &mut Scene| self.light.apply_environment(scene, &options);
        let work = Work { max_jobs, ..Work::default() };
        let setup = Setup::new(scene, &options, &memory, &self.units, work, light)?;
        if let Err(reason) = setup.prepared.wait_for_device() {
            log::warn!("tracing on the CPU alone: {reason}");
        }
        let scene = &setup.prepared.scene;
        let framed = || Camera::framing(&scene.bounds(), width as f32 / height as f32);
        let camera = self.camera.apply(scene.camera, framed);
        Ok((setup, camera))
    }
}
