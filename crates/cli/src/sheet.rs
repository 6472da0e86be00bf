//! The files of `--json`: rows of measurements or predictions, with the command and the machine.

use super::stats::{self, SCHEMA};
use anyhow::Result;
use raystream::engine::Units;
use raystream::meters::processor;
use serde::Serialize;
use std::path::Path;

/// The fields with which every file of `--json` begins.
#[derive(Serialize)]
pub struct Provenance {
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
    /// Of this process.
    pub fn here() -> Self {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let machine = Machine { processor: processor(), threads, simd: Units::cpu().simd().name() };
        let command =
            std::env::args_os().skip(1).map(|argument| argument.to_string_lossy().into_owned()).collect();
        Self { schema: SCHEMA, command, machine }
    }
}

/// A row with its scene.
#[derive(Serialize)]
pub struct SceneRow<'a, R> {
    #[serde(skip_serializing_if = "Option::is_none")]
    scene: Option<&'a str>,
    #[serde(flatten)]
    row: &'a R,
}

impl<'a, R> SceneRow<'a, R> {
    /// Rows of one scene.
    pub fn all(scene: Option<&'a str>, rows: &'a [R]) -> impl Iterator<Item = Self> {
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
pub fn write<R: Serialize>(path: Option<&Path>, scene: Option<&Path>, rows: &[R]) -> Result<()> {
    let Some(path) = path else { return Ok(()) };
    let scene = scene.map(|path| path.file_name().and_then(|name| name.to_str()).unwrap_or_default());
    let rows = SceneRow::all(scene, rows).collect();
    stats::write(path, &Sheet { provenance: Provenance::here(), rows })
}
