//! What a loader could not honour.

use std::collections::BTreeSet;

/// The most warnings that are kept: a damaged file could give one a line.
const MOST: usize = 100;

/// Warnings in the order in which they first came up, each once.
#[derive(Debug, Default)]
pub(super) struct Warnings {
    list: Vec<String>,
    seen: BTreeSet<String>,
}

impl Warnings {
    /// Adds a sentence unless it is there already.
    pub(super) fn add(&mut self, sentence: impl Into<String>) {
        let sentence = sentence.into();
        if self.list.len() > MOST || !self.seen.insert(sentence.clone()) {
            return;
        }
        self.list.push(if self.list.len() == MOST {
            "There are more warnings, which are left out.".into()
        } else {
            sentence
        });
    }

    /// The value held to `low..=high`, with a warning if it was outside.
    pub(super) fn clamp(&mut self, what: impl std::fmt::Display, value: f32, low: f32, high: f32) -> f32 {
        // NaN becomes the lower end.
        let held = if value >= low { value.min(high) } else { low };
        if held != value {
            self.add(format!("{what} is {value}; it must lie in {low} to {high}, so {held} is used."));
        }
        held
    }

    /// All of them.
    pub(super) fn into_list(self) -> Vec<String> {
        self.list
    }
}
