//! The peer that a user brings: Embree's shared library.
//!
//! Unsafe code for loading it. Invariant 1: the user names a library that is Embree 4 and that they want to run, as
//! the help of `--embree` says.
#![allow(unsafe_code, reason = "loads a foreign library; the invariant above")]

use super::super::args::{EmbreeArgs, PeerArgs};
use raystream_bench::embree::{Embree, EmbreeError};

impl EmbreeArgs {
    /// Loads Embree, if its library is given.
    pub fn load(&self) -> Result<Option<Embree>, EmbreeError> {
        // SAFETY: invariant 1.
        self.embree.as_deref().map(|library| unsafe { Embree::load(library) }).transpose()
    }
}

impl PeerArgs {
    /// Numbers of threads.
    pub fn thread_counts(&self) -> Vec<usize> {
        self.threads.iter().map(|&threads| threads as usize).collect()
    }
}
