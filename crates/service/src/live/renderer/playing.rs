//! Scenes that move: the time that is shown.

use super::Renderer;

impl Renderer {
    /// Refuses a time of a scene that looks the same at all times, and an animation that there is not.
    pub(super) fn check_time(&self, is_some: bool, animation: Option<&str>) -> Result<(), String> {
        let timed = self.view_scene.timed.as_ref();
        match (timed, animation) {
            (Some(timed), Some(name)) => timed.check(name).map_err(|error| error.to_string()),
            (None, Some(name)) => Err(format!("the scene has no animation {name:?}; it has no animations")),
            (None, None) if is_some && !self.prepared.scene.reads_moment() => {
                Err("the scene has no animation and no shader that reads the time, so it looks the same at any time"
                    .into())
            }
            _ => Ok(()),
        }
    }

    /// Moves the scene to the time that is wanted, if it is at another one.
    pub(super) fn move_scene(&mut self) -> Result<(), String> {
        let spec = &self.wanted.spec;
        if self.moved_spec.has_same_time(spec) {
            return Ok(());
        }
        let view_scene = &self.view_scene;
        let moved = spec.moved(&view_scene.prepared, view_scene.timed.as_ref())?;
        self.prepared = spec.edit(&moved)?;
        (self.moved, self.moved_spec) = (moved, spec.clone());
        Ok(())
    }
}
