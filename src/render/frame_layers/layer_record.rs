//! Origin of the layers of films in files.

use super::{Developer, FrameLayers};
use crate::film::{LayerPlan, Region};
use crate::render::Frame;
use crate::render::aov::{Aov, AovSet};
use crate::scene::{Lens, Material, Objects, Scene};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Origin of a film's layers, for files: the scene's names and the lens, but no geometry.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LayerRecord {
    aovs: Vec<String>,
    transparent: bool,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    denoised: bool,
    lens: Lens,
    objects: Objects,
    materials: Vec<String>,
}

impl LayerRecord {
    /// Of a frame; `None` if it has no layers.
    pub fn of(frame: &Frame) -> Option<Self> {
        let (aovs, scene) = (frame.aovs(), frame.scene());
        (!aovs.is_empty()).then(|| Self {
            aovs: aovs.iter().map(|aov| aov.name().to_owned()).collect(),
            transparent: aovs.is_transparent(),
            denoised: aovs.is_denoised(),
            lens: *frame.lens(),
            objects: Objects::clone(&scene.objects),
            materials: scene.materials.iter().map(|material| material.name.clone()).collect(),
        })
    }

    /// True if a film of this kind has these layers.
    pub fn is_of(&self, plan: &LayerPlan) -> bool {
        let Some(aovs) = self.aovs() else { return false };
        let wanted = aovs.plan(&self.names(), plan.samples);
        (wanted.hits, wanted.halves, wanted.centres) == (plan.hits, plan.halves, plan.centres)
            && wanted.sums.len() == plan.sums.len()
            && wanted.coverage == plan.coverage
    }

    fn aovs(&self) -> Option<AovSet> {
        let aovs: Option<Vec<Aov>> = self.aovs.iter().map(|name| name.parse().ok()).collect();
        let aovs = aovs?.into_iter().fold(AovSet::default(), AovSet::with);
        Some(aovs.with_transparent(self.transparent).with_denoised(self.denoised))
    }

    /// A scene that has names alone.
    fn names(&self) -> Scene {
        let materials = self.materials.iter().map(|name| Material::matte(name, Vec3::ZERO)).collect();
        Scene { objects: self.objects.clone().into(), materials, ..Scene::default() }
    }

    /// The developer of pictures of a region of films with these layers.
    pub fn developer(&self, region: Region) -> Developer {
        let aovs = self.aovs().unwrap_or_default();
        let layers =
            FrameLayers { bits: aovs.bits(), aovs, columns: Vec::new(), features: None, assets: Vec::new() };
        let scene = Arc::new(self.names());
        Developer { scene, lens: self.lens, region, layers: Some(Arc::new(layers)) }
    }
}
