//! Ctrl-C ends a frame early and keeps what there is.

use crate::schedule::Stopper;
use std::sync::Mutex;

static FRAME: Mutex<Option<Stopper>> = Mutex::new(None);

/// Makes the first Ctrl-C (or termination signal) stop this frame: no more camera rays, the paths in
/// flight finish, the picture is written. A second one ends the process at once.
pub fn stop_on_ctrl_c(frame: Stopper) {
    let lock = || FRAME.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    *lock() = Some(frame);
    let installed = ctrlc::set_handler(move || match lock().take() {
        Some(frame) => {
            eprintln!("\nstopping: paths in flight finish, then the picture is written (again to end at once)");
            frame.stop();
        }
        None => std::process::exit(130),
    });
    if let Err(error) = installed {
        log::warn!("Ctrl-C will end the frame without a picture: {error}");
    }
}
