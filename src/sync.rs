//! The synchronisation primitives of lock-free code, under one name: `tests/loom` compiles the same files with
//! loom's in their place and tries every interleaving of a few threads.

pub(crate) use std::hint::spin_loop;
pub(crate) use std::sync::atomic;
pub(crate) use std::sync::{Mutex, PoisonError};
pub(crate) use std::thread::yield_now;
