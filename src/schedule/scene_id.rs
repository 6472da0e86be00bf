//! The identity of a scene, which tracers and renderers have in common.

use std::any::Any;
use std::fmt;
use std::sync::Arc;

/// Which scene tracers trace and a renderer shades: primitive ids of one scene mean nothing in another. Two ids are
/// equal if they were made from the same `Arc`.
#[derive(Clone)]
pub struct SceneId(Arc<dyn Any + Send + Sync>);

impl SceneId {
    /// The id of a scene, which stays in memory as long as its id.
    pub fn of<T: Any + Send + Sync>(scene: &Arc<T>) -> Self {
        Self(Arc::clone(scene) as _)
    }

    fn address(&self) -> *const () {
        Arc::as_ptr(&self.0).cast()
    }
}

impl PartialEq for SceneId {
    fn eq(&self, other: &Self) -> bool {
        self.address() == other.address()
    }
}

impl Eq for SceneId {}

impl fmt::Debug for SceneId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("SceneId").field(&self.address()).finish()
    }
}
