//! Ctrl-C stops a frame early and keeps the samples taken so far.

use std::sync::atomic::{AtomicBool, Ordering::SeqCst};

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Installs the handler: the first Ctrl-C (or termination signal) requests that the frame stop; a second one ends
/// the process at once.
pub fn listen() {
    let installed = ctrlc::set_handler(|| {
        if REQUESTED.swap(true, SeqCst) {
            std::process::exit(130);
        }
        stderr_line!(
            "stopping: paths in flight finish, then the picture is written (press Ctrl-C again to quit at once)"
        );
    });
    if let Err(error) = installed {
        log::warn!("Ctrl-C will end the process without writing a picture: {error}");
    }
}

/// True if a stop was requested.
pub fn requested() -> bool {
    REQUESTED.load(SeqCst)
}
