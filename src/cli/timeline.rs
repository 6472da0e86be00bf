//! Timelines of a frame's tasks: Chrome trace JSON (opens in Perfetto) and SVG like RA's Figure 7.

use crate::film::write_whole;
use crate::schedule::{TaskKind, TaskRecord, ThreadKind, ThreadReport};
use anyhow::{Result, bail};
use serde_json::json;
use std::fmt::Write as _;
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

/// Writes the tasks of these threads.
pub fn write(path: &Path, threads: &[ThreadReport], tasks: &[TaskRecord]) -> Result<()> {
    let names = thread_names(threads);
    let text = match Format::of(path)? {
        Format::Json => chrome(&names, tasks),
        Format::Svg => svg(&names, tasks),
    };
    write_whole(path, |file| file.write_all(text.as_bytes()))?;
    Ok(())
}

fn name(kind: TaskKind) -> &'static str {
    match kind {
        TaskKind::Spawn => "spawn",
        TaskKind::Shade => "shade",
        TaskKind::Trace => "trace",
        TaskKind::Dispatch => "dispatch",
    }
}

/// RA's colours: camera rays blue, ray queries yellow, shading green.
fn colour(kind: TaskKind) -> &'static str {
    match kind {
        TaskKind::Spawn => "#3b6fb6",
        TaskKind::Shade => "#3f9b57",
        TaskKind::Trace => "#e3b23c",
        TaskKind::Dispatch => "#c8782d",
    }
}

/// Threads by the name of their kind and their number within it.
fn thread_names(threads: &[ThreadReport]) -> Vec<String> {
    let hosts = threads.iter().filter(|t| t.kind == ThreadKind::Host).count();
    (0..threads.len())
        .map(|i| if i < hosts { format!("host {i}") } else { format!("dispatch {}", i - hosts) })
        .collect()
}

fn chrome(names: &[String], tasks: &[TaskRecord]) -> String {
    let names = names.iter().enumerate().map(|(thread, name)| {
        json!({ "name": "thread_name", "ph": "M", "pid": 1, "tid": thread, "args": { "name": name } })
    });
    let tasks = tasks.iter().map(|task| {
        json!({ "name": name(task.kind), "cat": "task", "ph": "X", "pid": 1, "tid": task.thread,
            "ts": task.start_ns as f64 / 1e3, "dur": (task.end_ns - task.start_ns) as f64 / 1e3,
            "args": { "rays": task.rays } })
    });
    let events: Vec<_> = names.chain(tasks).collect();
    json!({ "displayTimeUnit": "ms", "traceEvents": events }).to_string()
}

const WIDTH: f64 = 1400.0;
const MARGIN: f64 = 76.0;
const LANE: f64 = 26.0;

fn svg(names: &[String], tasks: &[TaskRecord]) -> String {
    let end_ns = tasks.iter().map(|t| t.end_ns).max().unwrap_or(1).max(1);
    let height = LANE * names.len() as f64 + 46.0;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {height}\" font-family=\"sans-serif\" font-size=\"11\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        WIDTH + MARGIN + 8.0
    );
    for (lane, thread) in names.iter().enumerate() {
        let y = LANE * lane as f64;
        let _ = writeln!(out, "<text x=\"4\" y=\"{:.1}\">{thread}</text>", y + 17.0);
        let _ = writeln!(
            out,
            "<rect x=\"{MARGIN}\" y=\"{:.1}\" width=\"{WIDTH}\" height=\"{:.1}\" fill=\"#eeeeee\"/>",
            y + 2.0,
            LANE - 4.0
        );
    }
    for task in merged(tasks, end_ns) {
        let x = |ns: u64| MARGIN + WIDTH * ns as f64 / end_ns as f64;
        let (start, end) = (x(task.start_ns), x(task.end_ns));
        let y = LANE * f64::from(task.thread) + 2.0;
        let _ = writeln!(
            out,
            "<rect x=\"{start:.2}\" y=\"{y:.1}\" width=\"{:.2}\" height=\"{:.1}\" fill=\"{}\"><title>{}: {} rays, {:.3} ms</title></rect>",
            end - start,
            LANE - 4.0,
            colour(task.kind),
            name(task.kind),
            task.rays,
            (task.end_ns - task.start_ns) as f64 / 1e6
        );
    }
    let y = height - 14.0;
    let kinds = [TaskKind::Spawn, TaskKind::Trace, TaskKind::Dispatch, TaskKind::Shade];
    for (i, kind) in kinds.into_iter().enumerate() {
        let x = MARGIN + 110.0 * i as f64;
        let _ = writeln!(
            out,
            "<rect x=\"{x}\" y=\"{}\" width=\"12\" height=\"12\" fill=\"{}\"/><text x=\"{}\" y=\"{y}\">{}</text>",
            y - 10.0,
            colour(kind),
            x + 18.0,
            name(kind)
        );
    }
    let _ = writeln!(
        out,
        "<text x=\"{}\" y=\"{y}\" text-anchor=\"end\">{:.1} ms</text>\n</svg>",
        MARGIN + WIDTH,
        end_ns as f64 / 1e6
    );
    out
}

/// Tasks that follow each other on a thread within a thousandth of the picture are drawn as one, so that a
/// long frame stays a small file.
fn merged(timeline: &[TaskRecord], end_ns: u64) -> Vec<TaskRecord> {
    let gap = end_ns / 4000;
    let mut tasks = timeline.to_vec();
    tasks.sort_by_key(|t| (t.thread, t.start_ns));
    tasks.dedup_by(|next, kept| {
        let joins = kept.thread == next.thread
            && kept.kind == next.kind
            && next.start_ns.saturating_sub(kept.end_ns) < gap
            && next.end_ns - next.start_ns < gap;
        if joins {
            kept.end_ns = next.end_ns;
            kept.rays = kept.rays.saturating_add(next.rays);
        }
        joins
    });
    tasks
}
