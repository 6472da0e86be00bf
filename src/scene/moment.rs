//! The moment that a picture shows.

use super::Scene;
use super::fingerprint::encode_fields;

/// The moment that a picture shows, for surfaces of user code that ask for it. Nothing else of a scene depends on it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moment {
    /// Time in seconds.
    pub seconds: f32,
    /// Number of the frame; 0 for a single picture.
    pub frame: u32,
}

encode_fields!(Moment { seconds, frame });

impl Scene {
    /// True if a surface of user code asks for the moment, so that pictures depend on it.
    pub fn reads_moment(&self) -> bool {
        self.procedurals.iter().any(|surface| surface.reads_moment())
            || self.scatterings.iter().any(|surface| surface.reads_moment())
    }
}
