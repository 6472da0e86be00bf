//! Cameras of a file.

use super::{Camera, CameraMotion};
use serde::{Deserialize, Serialize};

/// A camera of a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct NamedCamera {
    /// Its name in the file, made unique.
    pub name: String,
    /// The camera.
    pub camera: Camera,
    /// Its animation. `None` if it does not move.
    pub motion: Option<CameraMotion>,
}

impl NamedCamera {
    /// A camera that does not move.
    pub fn new(name: impl Into<String>, camera: Camera) -> Self {
        Self { name: name.into(), camera, motion: None }
    }

    /// This camera with an animation.
    pub fn with_motion(self, motion: Option<CameraMotion>) -> Self {
        Self { motion, ..self }
    }
}
