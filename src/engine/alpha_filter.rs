//! The scene as the filter that decides at each candidate hit whether its surface is there (alpha).

use crate::bvh::Filter;
use crate::scene::{AlphaMode, Scene};
use std::sync::Arc;

impl Filter for Scene {
    fn accepts(&self, primitive: u32, u: f32, v: f32) -> bool {
        self.alpha_accepts(primitive, u, v)
    }
}

/// The scene as a filter of hits; `None` where all its materials are opaque.
pub(super) fn filter(scene: &Arc<Scene>) -> Option<Arc<dyn Filter>> {
    let is_masked = scene.materials.iter().any(|material| material.alpha.mode != AlphaMode::Opaque);
    is_masked.then(|| scene.clone() as Arc<dyn Filter>)
}
