//! The profile that this crate was compiled with.
//!
//! Cargo ignores the profiles of dependencies, so in a user's `cargo run` and `cargo test` raystream is compiled
//! without optimisation unless the user's manifest says otherwise. Everything works in such a build, about a hundred
//! times slower: vector instructions are then calls of functions. The first tree of the process warns.
//! `docs/results/profiles.md` has the times.

use std::sync::Once;

/// Cargo's `opt-level` for this crate: `0` to `3`, `s` or `z`.
pub const OPT_LEVEL: &str = env!("RAYSTREAM_OPT_LEVEL");

/// Warns once a process if this crate was compiled without optimisation: through `log`, or on standard error where
/// no logger is installed.
pub(crate) fn warn_if_unoptimised() {
    static WARNED: Once = Once::new();
    if cfg!(unoptimised) {
        WARNED.call_once(|| warn(UNOPTIMISED));
    }
}

const UNOPTIMISED: &str = "raystream was compiled without optimisation and is about 100 times slower. Put these \
                           lines into the Cargo.toml of your workspace; all but the first two only make building \
                           shorter:\n\
                           [profile.dev.package.\"*\"]\n\
                           opt-level = 3\n\
                           codegen-units = 16\n\
                           debug = false\n\
                           debug-assertions = false\n\
                           overflow-checks = false";

/// Logs a warning, or prints it where no logger is installed.
#[doc(hidden)]
pub fn warn(message: &str) {
    if log::max_level() == log::LevelFilter::Off {
        eprintln!("warning: {message}");
    } else {
        log::warn!("{message}");
    }
}
