//! Lines of progress, for logs and for programs that read them.

use crate::Outcome;
use serde::Serialize;
use std::time::Instant;

/// The stage of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// Reads the scene and builds its tree.
    Loading,
    /// Renders.
    Rendering,
    /// Writes files.
    Writing,
}

/// The progress of a command.
#[derive(Clone, Debug)]
pub struct Now {
    pub stage: Stage,
    pub began: Instant,
    /// Share of the samples that have been taken.
    pub share: f64,
    pub rays: u64,
    pub mray_per_s: f64,
    /// Seconds that rendering will take, if they can be told.
    pub left_s: Option<f64>,
    pub is_over: bool,
}

impl Now {
    pub fn new() -> Self {
        let (stage, began) = (Stage::Loading, Instant::now());
        Self { stage, began, share: 0.0, rays: 0, mray_per_s: 0.0, left_s: None, is_over: false }
    }

    /// The stage in words.
    fn text(&self) -> String {
        match self.stage {
            Stage::Loading => "loading the scene".into(),
            Stage::Rendering if self.rays == 0 => "rendering".into(),
            Stage::Rendering => {
                let left = self.left_s.map_or_else(String::new, |left_s| format!(", {left_s:.0} s left"));
                format!("rendering, {:.1} Mray/s{left}", self.mray_per_s)
            }
            Stage::Writing => "writing".into(),
        }
    }
}

/// A JSON line.
#[derive(Serialize)]
struct Record<'a> {
    stage: &'a str,
    elapsed_s: f64,
    progress: f64,
    rays: u64,
    mray_per_s: f64,
    left_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    exit_code: Option<u8>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<&'a str>,
}

impl<'a> Record<'a> {
    fn of(now: &Now) -> Self {
        let stage = match now.stage {
            Stage::Loading => "loading",
            Stage::Rendering => "rendering",
            Stage::Writing => "writing",
        };
        Self {
            stage,
            elapsed_s: now.began.elapsed().as_secs_f64(),
            progress: now.share,
            rays: now.rays,
            mray_per_s: now.mray_per_s,
            left_s: now.left_s,
            exit_code: None,
            error: None,
        }
    }

    fn print(&self) {
        stderr_line!("{}", serde_json::to_string(self).expect("numbers and texts are JSON"));
    }
}

/// The destination of lines, and their form.
pub enum Lines {
    /// On standard error.
    Plain,
    /// On standard error, one object a line.
    Json,
    /// On standard output, as Open Job Description's sessions read them.
    OpenJd,
    #[cfg(test)]
    Captured(std::sync::Arc<std::sync::Mutex<Vec<String>>>),
}

impl Lines {
    /// Tells of a new stage, if the form has a line for it.
    pub fn enter(&self, now: &Now) {
        match self {
            Self::Plain => {}
            _ => self.tick(now),
        }
    }

    /// Tells how far the command is.
    pub fn tick(&self, now: &Now) {
        match self {
            Self::Plain => {
                let elapsed_s = now.began.elapsed().as_secs_f64();
                stderr_line!("{:.1} % after {elapsed_s:.0} s: {}", 100.0 * now.share, now.text());
            }
            Self::Json => Record::of(now).print(),
            Self::OpenJd => {
                stdout_line!("openjd_progress: {:.1}", 100.0 * now.share);
                stdout_line!("openjd_status: {}", now.text());
            }
            #[cfg(test)]
            Self::Captured(told) => told.lock().expect("no panic").push(format!("{now:?}")),
        }
    }

    /// Tells that there is a result.
    pub fn end(&self, now: &Now, outcome: &Outcome) {
        let exit_code = outcome.exit_code();
        match self {
            Self::Json => {
                Record { stage: "done", left_s: None, exit_code: Some(exit_code), ..Record::of(now) }.print();
            }
            Self::OpenJd => match outcome {
                Outcome::Done => {
                    stdout_line!("openjd_progress: 100.0");
                    stdout_line!("openjd_status: done");
                }
                Outcome::Degraded => {
                    stdout_line!("openjd_fail: exit code {exit_code}: the events are on standard error");
                }
            },
            _ => {}
        }
    }

    /// Tells that the command could not run.
    pub fn fail(&self, now: &Now, error: &str) {
        match self {
            Self::Json => {
                let (exit_code, error) = (Some(2), Some(error));
                Record { stage: "failed", left_s: None, exit_code, error, ..Record::of(now) }.print();
            }
            Self::OpenJd => stdout_line!("openjd_fail: {}", error.replace(['\n', '\r'], " ")),
            _ => {}
        }
    }

    #[cfg(test)]
    pub fn captured() -> (Self, std::sync::Arc<std::sync::Mutex<Vec<String>>>) {
        let told = std::sync::Arc::default();
        (Self::Captured(std::sync::Arc::clone(&told)), told)
    }
}
