//! The peers that a user brings: shared libraries of Embree and tinybvh.
//!
//! Unsafe code for loading them. Invariant 1: the user names libraries that are what the help of the options says and
//! that they want to run.
#![allow(unsafe_code, reason = "loads foreign libraries; the invariant above")]

use super::super::args::{LibraryArgs, PeerArgs};
use raystream_bench::embree::Embree;
use raystream_bench::tinybvh::TinyBvh;
use raystream_bench::{PeerError, Peers};

/// The libraries that are given, loaded.
pub struct Libraries {
    embree: Option<Embree>,
    tinybvh: Option<TinyBvh>,
}

impl LibraryArgs {
    /// Loads the libraries that are given.
    pub fn load(&self) -> Result<Libraries, PeerError> {
        // SAFETY: invariant 1.
        let embree = self.embree.as_deref().map(|library| unsafe { Embree::load(library) }).transpose()?;
        // SAFETY: invariant 1.
        let tinybvh = self.tinybvh.as_deref().map(|library| unsafe { TinyBvh::load(library) }).transpose()?;
        Ok(Libraries { embree, tinybvh })
    }
}

impl Libraries {
    /// Those that take part in a measurement.
    pub fn peers(&self) -> Peers<'_> {
        Peers { embree: self.embree.as_ref(), tinybvh: self.tinybvh.as_ref() }
    }
}

impl PeerArgs {
    /// Numbers of threads.
    pub fn thread_counts(&self) -> Vec<usize> {
        self.threads.iter().map(|&threads| threads as usize).collect()
    }
}
