//! Warnings about features of a file that the loader ignored or changed.

use std::collections::BTreeSet;

/// The most warnings that are kept, because a damaged file could cause one for each line.
const MAX_WARNINGS: usize = 100;

/// Warnings in the order of their first occurrence, each once.
#[derive(Clone, Debug, Default)]
pub(super) struct Warnings {
    list: Vec<String>,
    sentences: BTreeSet<String>,
}

impl Warnings {
    /// Adds a sentence unless the list contains it already.
    pub(super) fn add(&mut self, sentence: impl Into<String>) {
        let sentence = sentence.into();
        if self.list.len() > MAX_WARNINGS || !self.sentences.insert(sentence.clone()) {
            return;
        }
        self.list.push(if self.list.len() == MAX_WARNINGS {
            "There are more warnings, which are left out.".into()
        } else {
            sentence
        });
    }

    /// Clamps a value to `low..=high`, with a warning if it is outside.
    #[cfg(feature = "formats")]
    pub(super) fn clamp(&mut self, what: impl std::fmt::Display, value: f32, low: f32, high: f32) -> f32 {
        // NaN becomes `low`.
        let clamped = if value >= low { value.min(high) } else { low };
        if clamped != value {
            self.add(format!("{what} is {value}; it must be from {low} to {high}, so {clamped} is used."));
        }
        clamped
    }

    /// All warnings so far.
    pub(super) fn list(&self) -> &[String] {
        &self.list
    }

    /// All warnings.
    pub(super) fn into_list(self) -> Vec<String> {
        self.list
    }
}
