//! Options in a file, JSON or TOML.

use super::{RenderSpec, SpecError};
use serde_json::Value;
use std::ffi::OsStr;
use std::fmt;
use std::path::Path;

/// A place in a text, counted from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// The line.
    pub line: usize,
    /// The column, in characters.
    pub column: usize,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.line, self.column)
    }
}

/// A key of a file with its value.
#[derive(Clone, Debug, PartialEq)]
pub struct FileEntry {
    /// The key.
    pub name: String,
    /// Its value.
    pub value: Value,
    /// Place of the key.
    pub place: Place,
}

/// Reads the keys and values of a file; the extension of its name tells the format.
///
/// # Errors
/// If the text is not in that format. The message has path, line and column.
pub fn file_entries(path: &Path, text: &str) -> Result<Vec<FileEntry>, SpecError> {
    let name = path.display();
    let value: Value = match path.extension().and_then(OsStr::to_str) {
        Some("json") => serde_json::from_str(text).map_err(|error| {
            let told = error.to_string();
            let told = told.split(" at line ").next().unwrap_or_default();
            SpecError::new(format!("{name}:{}:{}: not JSON: {told}", error.line(), error.column()))
        })?,
        Some("toml") => toml::from_str(text).map_err(|error| {
            let start = error.span().map_or(0, |span| span.start);
            SpecError::new(format!("{name}:{}: not TOML: {}", place_at(text, start), error.message()))
        })?,
        _ => {
            let wrong = format!("{name}: unknown file extension; the name must end in .toml or .json");
            return Err(SpecError::new(wrong));
        }
    };
    let Value::Object(options) = value else {
        return Err(SpecError::new(format!("{name}:1:1: write an object whose keys are names of options")));
    };
    let entry = |(name, value): (String, Value)| {
        let place = place_of(text, &name);
        FileEntry { name, value, place }
    };
    Ok(options.into_iter().map(entry).collect())
}

impl RenderSpec {
    /// Reads a spec from a `.json` or `.toml` file. Files that it names lie beside it or where their paths lead from
    /// there.
    ///
    /// # Errors
    /// If the file cannot be read or holds anything else than options of a picture. The message has path, line and
    /// column.
    pub fn read(path: &Path) -> Result<Self, SpecError> {
        let name = path.display();
        let text = std::fs::read_to_string(path).map_err(|error| SpecError {
            told: format!("{name}: cannot be read: {error}"),
            os_error: error.raw_os_error(),
        })?;
        let mut spec = Self::default();
        for FileEntry { name: key, value, place } in file_entries(path, &text)? {
            spec.set(&key, &value).map_err(|error| SpecError::new(format!("{name}:{place}: {error}")))?;
        }
        spec.within(path.parent().unwrap_or(Path::new("")))
    }
}

/// Where a key stands: before `=` or `:`, perhaps in quotes.
fn place_of(text: &str, key: &str) -> Place {
    let is_key = |&(start, _): &(usize, &str)| {
        let before = text[..start].chars().next_back();
        let after = text[start + key.len()..].trim_start_matches(['"', '\'']).trim_start();
        before.is_none_or(|c| c.is_whitespace() || matches!(c, '"' | '\'' | '{' | ','))
            && after.starts_with(['=', ':'])
    };
    place_at(text, text.match_indices(key).find(is_key).map_or(0, |(start, _)| start))
}

fn place_at(text: &str, at: usize) -> Place {
    let before = &text[..at.min(text.len())];
    let line = before.rsplit('\n').next().unwrap_or_default();
    Place { line: 1 + before.matches('\n').count(), column: 1 + line.chars().count() }
}
