//! Messages on standard error: text, or lines of JSON for programs that collect logs.

use env_logger::fmt::{ConfigurableFormat, Formatter};
use log::Record;
use serde_json::{Value, json};
use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::time::SystemTime;

/// Subjects of messages. A message that has some begins with them, each a word and a name.
const SUBJECTS: [&str; 6] = ["job", "request", "unit", "worker", "scene", "delivery"];

static AS_JSON: AtomicBool = AtomicBool::new(false);

/// The form of messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum LogFormat {
    /// Lines for people.
    Text,
    /// A JSON object a line.
    Json,
}

impl LogFormat {
    /// Chooses the form of all messages from here on.
    pub fn choose(self) {
        AS_JSON.store(self == Self::Json, SeqCst);
    }
}

/// The variable of the environment that chooses the form, `json`, for all commands.
pub const FORMAT: &str = "RAYSTREAM_LOG_FORMAT";

/// Starts the log. `RUST_LOG` says what is shown.
pub fn start() {
    if std::env::var(FORMAT).is_ok_and(|form| form == "json") {
        LogFormat::Json.choose();
    }
    let mut text = ConfigurableFormat::default();
    text.timestamp(None).target(false);
    env_logger::Builder::from_env(
        env_logger::Env::default()
            .default_filter_or("warn,raystream=info,wgpu=off,wgpu_core=off,wgpu_hal=off,naga=off"),
    )
    .format(move |to, record| match AS_JSON.load(SeqCst) {
        true => write_json(to, record),
        false => text.format(to, record),
    })
    .init();
}

fn write_json(to: &mut Formatter, record: &Record<'_>) -> io::Result<()> {
    let mut line = of_message(&record.args().to_string());
    let now = SystemTime::UNIX_EPOCH.elapsed().map_or(0, |since| since.as_millis() as u64);
    line["time_ms"] = json!(now);
    line["level"] = json!(record.level().as_str().to_lowercase());
    line["target"] = json!(record.target());
    writeln!(to, "{line}")
}

/// A message, and what it is about as fields of their own: `job 7f, request a: done` is
/// `{"job": "7f", "request": "a", "message": "done"}`.
fn of_message(message: &str) -> Value {
    let about = message.split_once(": ").and_then(|(start, rest)| {
        let mut line = json!({ "message": rest });
        for about in start.split(", ") {
            let (subject, name) = about.split_once(' ')?;
            let subject = SUBJECTS.into_iter().find(|known| *known == subject)?;
            line[subject] = json!(name);
        }
        Some(line)
    });
    about.unwrap_or_else(|| json!({ "message": message }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_say_what_they_are_about() {
        for (message, line) in [
            ("job 7f: done: really", json!({ "job": "7f", "message": "done: really" })),
            (
                "job 7f, request a, unit 7f.0: done",
                json!({ "job": "7f", "request": "a", "unit": "7f.0", "message": "done" }),
            ),
            ("job 7f, the last: done", json!({ "message": "job 7f, the last: done" })),
            ("request a b: no", json!({ "request": "a b", "message": "no" })),
            ("/a/b: cannot be read", json!({ "message": "/a/b: cannot be read" })),
            ("jobs 7f: many", json!({ "message": "jobs 7f: many" })),
            ("a \"line\"\nand more", json!({ "message": "a \"line\"\nand more" })),
        ] {
            assert_eq!(of_message(message), line);
        }
    }
}
