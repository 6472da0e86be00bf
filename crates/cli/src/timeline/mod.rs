//! Timelines of a frame's tasks: Chrome trace JSON (opens in Perfetto) and SVG like RA's Figure 7, with clocks and
//! power over time as in RA's Figure 5.

mod chrome;
mod svg;

use anyhow::{Result, bail};
use raystream::files;
use raystream::schedule::{TaskKind, TaskRecord, ThreadKind, ThreadReport};
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
    /// The format that a file's extension names.
    pub fn of(path: &Path) -> Result<Self> {
        match path.extension().and_then(|e| e.to_str()) {
            Some("json") => Ok(Self::Json),
            Some("svg") => Ok(Self::Svg),
            _ => bail!(
                "{}: a timeline is written as .json or .svg; give the file one of these extensions",
                path.display()
            ),
        }
    }
}

/// A timeline; times are in nanoseconds since the first job began.
pub struct Timeline {
    /// Names of the threads, by the number in task records.
    pub threads: Vec<String>,
    /// Tasks in the order in which they ended.
    pub tasks: Vec<TaskRecord>,
    /// True if all tasks belong to one job, whose list lengths can then be shown.
    pub is_one_job: bool,
    /// Clocks and power.
    pub curves: Vec<Curve>,
}

/// A number over time.
#[derive(Clone)]
pub struct Curve {
    /// The name of what is measured.
    pub name: String,
    /// Unit.
    pub unit: &'static str,
    /// Times in nanoseconds, and values.
    pub points: Vec<(u64, f64)>,
}

impl Timeline {
    /// Writes the timeline in the format that the file's extension names.
    pub fn write(&self, path: &Path) -> Result<()> {
        let text = match Format::of(path)? {
            Format::Json => chrome::text(self),
            Format::Svg => svg::text(self),
        };
        files::write(path, |file| file.write_all(text.as_bytes()))?;
        Ok(())
    }

    /// The tasks whose records hold list lengths.
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
        TaskKind::Resolve => "resolve",
        _ => "other",
    }
}

/// Thread names: kind and number within the kind.
pub fn thread_names(threads: &[ThreadReport]) -> Vec<String> {
    let name = |(index, thread): (usize, &ThreadReport)| match thread.kind {
        ThreadKind::Host => format!("host {index}"),
        ThreadKind::Device => "device".to_owned(),
        _ => "caller".to_owned(),
    };
    threads.iter().enumerate().map(name).collect()
}
