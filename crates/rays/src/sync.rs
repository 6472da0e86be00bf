//! The synchronisation primitives of streams, under one name: `tests/loom` compiles the same files with loom's in their
//! place and tries every interleaving of a few threads.

pub(crate) use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
