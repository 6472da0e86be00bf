//! The scene's alpha test as a filter of candidate hits.

use crate::bvh::Filter;
use crate::scene::Scene;
use std::sync::Arc;

impl Filter for Scene {
    fn accepts(&self, primitive: u32, u: f32, v: f32) -> bool {
        self.alpha_accepts(primitive, u, v)
    }
}

/// A filter that applies the scene's alpha test. `None` if all materials are opaque.
pub(super) fn filter(scene: &Arc<Scene>) -> Option<Arc<dyn Filter>> {
    let is_masked = scene.masked_materials().contains(&true);
    is_masked.then(|| scene.clone() as Arc<dyn Filter>)
}
