//! The names and times of a file's animations.

use serde::{Deserialize, Serialize};

/// An animation of a scene's file that moves more than cameras.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct AnimationSpan {
    /// Its name, for [`super::load::LoadOptions::with_animation`].
    pub name: String,
    /// The time of its first key in seconds.
    pub first: f64,
    /// The time of its last key in seconds.
    pub last: f64,
}

impl AnimationSpan {
    /// An animation.
    pub fn new(name: impl Into<String>, first: f64, last: f64) -> Self {
        Self { name: name.into(), first, last }
    }
}
