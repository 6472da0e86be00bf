//! The command line of raystream.
//!
//! This file alone changes the process's environment. Invariant 1: `main` does so before any thread is made,
//! so no thread reads the environment meanwhile.
#![allow(unsafe_code, reason = "the invariants above")]

fn main() -> std::process::ExitCode {
    // Mesa's device-selection layer asks for a display server to order the GPUs by, and complains on stderr
    // where there is none. raystream orders adapters itself.
    if std::env::var_os("NODEVICE_SELECT").is_none() {
        // SAFETY: invariant 1.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
    raystream::cli::run()
}
