//! From a spec to a rendering, in one call.

use super::checked::afford;
use super::spec::RenderSpec;
use super::{CheckedSpec, Moving, Registry, Rendering, scene_file};
use crate::engine::{PreparedScene, Units};
use crate::memory::MemoryBudget;
use crate::scene::Scene;
use anyhow::{Context, Result};
use std::path::Path;

/// Opens what a spec describes, with the integrators of raystream: reads the scene, builds its tree. Relative paths of
/// files lead from `folder`.
///
/// ```
/// use raystream::engine::Units;
/// use raystream::picture::{RenderSpec, open};
/// use raystream::schedule::{Service, ServiceOptions};
///
/// # let folder = tempfile::tempdir()?;
/// # let folder = folder.path();
/// # std::fs::write(folder.join("ball.json"), r#"{ "environment": [1, 1, 1],
/// #     "materials": { "grey": { "colour": [0.5, 0.5, 0.5] } }, "shapes":
/// #     [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 8, "material": "grey" } ] }"#)?;
/// let spec: RenderSpec = serde_json::from_str(r#"{ "scene": "ball.json", "size": [32, 32], "spp": 4 }"#)?;
/// let rendering = open(&spec, folder, &Units::cpu())?;
/// let picture = rendering.render(&Service::new(ServiceOptions::default())?, 0)?;
/// assert_eq!(picture.image.pixels.len(), 32 * 32);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// What is wrong with the spec or the scene.
pub fn open(spec: &RenderSpec, folder: &Path, units: &Units) -> Result<Rendering> {
    open_with(spec, folder, units, &Registry::built_in())
}

/// [`open()`] with integrators and surfaces of your own.
///
/// # Errors
/// What is wrong with the spec or the scene.
pub fn open_with(spec: &RenderSpec, folder: &Path, units: &Units, registry: &Registry) -> Result<Rendering> {
    let checked = CheckedSpec::new(spec.clone().within(folder)?, registry)?;
    checked.check_denoiser()?;
    let memory = MemoryBudget::of_machine();
    checked.afford(&memory, 1)?;
    let path = checked.scene_file()?;
    let options = checked.spec().loading.options(&memory);
    let scene = scene_file::read(path, &options)?;
    let rendering = prepared(&checked, scene, units, &memory)?;
    Ok(rendering.with_moving(|| Moving::new(options, memory)))
}

/// [`open_with`] for a scene in memory.
///
/// # Errors
/// What is wrong with the spec or the scene.
pub fn open_scene(spec: &RenderSpec, scene: Scene, units: &Units, registry: &Registry) -> Result<Rendering> {
    let checked = CheckedSpec::new(spec.clone(), registry)?;
    checked.check_denoiser()?;
    let memory = MemoryBudget::of_machine();
    checked.afford(&memory, 1)?;
    prepared(&checked, scene, units, &memory)
}

fn prepared(
    checked: &CheckedSpec,
    mut scene: Scene,
    units: &Units,
    memory: &MemoryBudget,
) -> Result<Rendering> {
    drop(checked.change(&mut scene, &checked.spec().loading.options(memory))?);
    let bytes = PreparedScene::building_bytes(&scene).saturating_add(checked.picture_bytes());
    afford(memory, "the scene with its tree and the picture".into(), bytes)?;
    let name = || checked.spec().scene.as_ref().map_or("the scene".into(), |path| path.display().to_string());
    checked.rendering(PreparedScene::new(scene, units).with_context(name)?)
}
