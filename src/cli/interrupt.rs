//! Ctrl-C ends a frame early and keeps what there is.

use std::sync::atomic::{AtomicBool, Ordering::SeqCst};

static ASKED: AtomicBool = AtomicBool::new(false);

/// From now on the first Ctrl-C (or termination signal) only asks the frame to stop; a second one ends the
/// process at once.
pub fn listen() {
    let installed = ctrlc::set_handler(|| {
        if ASKED.swap(true, SeqCst) {
            std::process::exit(130);
        }
        eprintln!("stopping: paths in flight finish, then the picture is written (again to end at once)");
    });
    if let Err(error) = installed {
        log::warn!("Ctrl-C will end the frame without a picture: {error}");
    }
}

/// Whether the frame should stop.
pub fn asked() -> bool {
    ASKED.load(SeqCst)
}
