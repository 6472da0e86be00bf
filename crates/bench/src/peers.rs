//! Peers whose libraries a user brings.

use super::embree::{Embree, EmbreeError};
use super::tinybvh::{TinyBvh, TinyBvhError};

/// The libraries that take part.
#[derive(Clone, Copy, Debug, Default)]
pub struct Peers<'a> {
    /// Embree 4.
    pub embree: Option<&'a Embree>,
    /// tinybvh.
    pub tinybvh: Option<&'a TinyBvh>,
}

/// Error of a peer.
#[derive(Debug, thiserror::Error)]
pub enum PeerError {
    /// Embree reports an error.
    #[error(transparent)]
    Embree(#[from] EmbreeError),
    /// tinybvh reports an error.
    #[error(transparent)]
    TinyBvh(#[from] TinyBvhError),
}
