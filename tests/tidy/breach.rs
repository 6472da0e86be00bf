//! What breaks a rule, and where.

use std::fmt;

/// One breach of a rule.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Breach {
    /// Path below the repository's root.
    pub file: String,
    /// Line, counted from 1.
    pub line: usize,
    /// What is wrong there, and what would be right.
    pub what: String,
}

impl Breach {
    pub fn new(file: &str, line: usize, what: impl Into<String>) -> Self {
        Self { file: file.into(), line, what: what.into() }
    }
}

impl fmt::Display for Breach {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.file, self.line, self.what)
    }
}

/// Fails with all breaches, one a line.
pub fn assert_none(rule: &str, mut breaches: Vec<Breach>) {
    breaches.sort();
    breaches.dedup();
    let lines: Vec<String> = breaches.iter().map(ToString::to_string).collect();
    assert!(lines.is_empty(), "{rule} ({} breaches)\n{}", lines.len(), lines.join("\n"));
}

/// Asserts that a rule names exactly these breaches, each as `file:line: ` and a part of what is said.
pub fn assert_named(breaches: &[Breach], expected: &[(&str, &str)]) {
    let lines: Vec<String> = breaches.iter().map(ToString::to_string).collect();
    let named = |(place, part): &(&str, &str)| {
        lines.iter().any(|line| line.starts_with(&format!("{place}: ")) && line.contains(part))
    };
    assert!(expected.iter().all(named) && lines.len() == expected.len(), "{lines:#?}\n{expected:#?}");
}
