//! The record of who did what: a file of lines of JSON in the data folder, to which the service and the commands beside
//! it add. It holds names of tokens, never their texts.

use super::ledger::now_ms;
use serde_json::{Value, json};
use std::fs::OpenOptions;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// The file, and the one before it.
const FILE: &str = "audit.jsonl";
const BEFORE: &str = "audit.before.jsonl";

/// Bytes from which a new file is begun: refusals of strangers fill no disk.
const MOST_BYTES: u64 = 64 << 20;

/// The record of a data folder.
#[derive(Clone, Debug)]
pub struct AuditLog {
    data: PathBuf,
    most_bytes: u64,
}

impl AuditLog {
    /// That of a data folder.
    pub fn new(data: &Path) -> Self {
        Self { data: data.to_owned(), most_bytes: MOST_BYTES }
    }

    /// Adds a line: the time, what was done, and more about it. If the disk refuses, the log says so.
    pub fn note(&self, what: &str, more: Value) {
        let mut line = json!({ "time_ms": now_ms(), "what": what });
        if let (Some(line), Value::Object(more)) = (line.as_object_mut(), more) {
            line.extend(more);
        }
        if let Err(error) = self.add(&line) {
            log::warn!("{}: {error}; not written down: {line}", self.data.join(FILE).display());
        }
    }

    fn add(&self, line: &Value) -> io::Result<()> {
        let path = self.data.join(FILE);
        let mut options = OpenOptions::new();
        options.append(true).create(true);
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        let mut file = options.open(&path)?;
        if file.metadata()?.len() >= self.most_bytes {
            std::fs::rename(&path, self.data.join(BEFORE))?;
            file = options.open(&path)?;
        }
        // In one piece: others may add lines at the same time.
        file.write_all(format!("{line}\n").as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_whole_and_old_files_make_room() {
        let folder = tempfile::tempdir().expect("a folder");
        let log = AuditLog { most_bytes: 1000, ..AuditLog::new(folder.path()) };
        std::thread::scope(|scope| {
            for thread in 0..4 {
                let log = log.clone();
                scope.spawn(move || (0..3).for_each(|n| log.note("tried", json!({ "by": [thread, n] }))));
            }
        });
        let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap_or_default();
        let all: Vec<Value> =
            read(FILE).lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
        assert!(
            all.len() == 12 && all.iter().all(|line| line["what"] == "tried" && line["time_ms"].is_i64())
        );
        (0..30).for_each(|n| log.note("again", json!({ "n": n })));
        assert!(read(FILE).len() < 1100 && read(BEFORE).len() > 900, "a file of both");
        assert!(read(FILE).contains("29"), "{}", read(FILE));
    }
}
