//! `raystream view`.

use super::{backend, serve};
use crate::Outcome;
use crate::service::args::ViewArgs;
use anyhow::{Context, Result, anyhow};
use raystream::picture::{Registry, RenderSpec};

/// Starts the service for one scene, and a browser where there is one.
pub fn run(args: &ViewArgs, registry: Registry) -> Result<Outcome> {
    let scene = args.scene.canonicalize().with_context(|| args.scene.display().to_string())?;
    let folder = scene.parent().unwrap_or(&scene).to_owned();
    let backend = backend(registry, &args.service)?;
    // A scene that cannot be read ends the command, and one that can be is ready when the page asks for it.
    backend.open(&RenderSpec::default(), &scene, &folder).map_err(|error| anyhow!(error))?;
    let opens_browser = !args.no_browser && has_display();
    serve(&args.service, backend, Some(&scene), move |page| {
        if opens_browser && let Err(error) = open::that_detached(page) {
            log::info!("no browser was started ({error}); open the address in one");
        }
    })
}

/// True if a browser would have a window. Where windows come from a display server, a program without one may be a
/// browser for terminals, which shows no pictures.
fn has_display() -> bool {
    let has = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    !cfg!(all(unix, not(target_os = "macos"))) || has("DISPLAY") || has("WAYLAND_DISPLAY")
}
