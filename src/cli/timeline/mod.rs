//! Timelines of a frame's tasks: Chrome trace JSON (opens in Perfetto) and SVG like RA's Figure 7, with clocks and
//! power over time as in RA's Figure 5.

mod chrome;
mod svg;

use crate::film::write_whole;
use crate::schedule::{TaskKind, TaskRecord, ThreadKind, ThreadReport};
use anyhow::{Result, bail};
use std::io::Write as _;
use std::path::Path;

/// File formats of timelines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Chrome trace events.
    Json,
    /// A picture.
    Svg,
}

impl Format {
    /// The format a file's extension names.
    pub fn of(path: &Path) -> Result<Self> {
        match path.extension().and_then(|e| e.to_str()) {
            Some("json") => Ok(Self::Json),
            Some("svg") => Ok(Self::Svg),
            _ => bail!("{}: a timeline is written as .json or .svg; name the file so", path.display()),
        }
    }
}

/// What a timeline shows; times are in nanoseconds since the first job began.
pub struct Timeline {
    /// Threads by name, as tasks number them.
    pub threads: Vec<String>,
    /// In the order in which they ended.
    pub tasks: Vec<TaskRecord>,
    /// Whether the tasks are all one job's, so that its lists can be shown.
    pub is_one_job: bool,
    /// Clocks and power.
    pub curves: Vec<Curve>,
}

/// A number over time.
#[derive(Clone)]
pub struct Curve {
    /// Of what.
    pub name: String,
    /// In what.
    pub unit: &'static str,
    /// When, and how much.
    pub points: Vec<(u64, f64)>,
}

impl Timeline {
    /// Writes it in the format that the file's extension names.
    pub fn write(&self, path: &Path) -> Result<()> {
        let text = match Format::of(path)? {
            Format::Json => chrome::text(self),
            Format::Svg => svg::text(self),
        };
        write_whole(path, |file| file.write_all(text.as_bytes()))?;
        Ok(())
    }

    /// The tasks whose records tell the lengths of the lists.
    fn lists(&self) -> &[TaskRecord] {
        if self.is_one_job { &self.tasks } else { &[] }
    }

    fn end_ns(&self) -> u64 {
        self.tasks.iter().map(|task| task.end_ns).max().unwrap_or(1).max(1)
    }
}

fn name(kind: TaskKind) -> &'static str {
    match kind {
        TaskKind::Spawn => "spawn",
        TaskKind::Shade => "shade",
        TaskKind::Trace => "trace",
        TaskKind::Dispatch => "dispatch",
    }
}

/// Threads by the name of their kind and their number within it.
pub fn thread_names(threads: &[ThreadReport]) -> Vec<String> {
    let hosts = threads.iter().filter(|t| t.kind == ThreadKind::Host).count();
    (0..threads.len())
        .map(|i| if i < hosts { format!("host {i}") } else { format!("dispatch {}", i - hosts) })
        .collect()
}
