//! The surfaces of a scene that rays may pass: surfaces of computed opacity, and clear walls.

use crate::lanes::{Int, Lanes, Mask, Num, Vector};
use crate::scene::{Material, Scene};
use crate::shade::bsdf::is_pane;
use crate::shade::{SurfaceBounds, sought_materials};

/// The surfaces that rays may pass.
#[derive(Debug)]
pub(super) struct Passable {
    /// For each material, true if it is a clear wall that rays may pass.
    panes: Vec<bool>,
    /// For each material, 1 if it is such a surface or a mix with one, else 0.
    materials: Vec<u32>,
    bounds: SurfaceBounds,
    /// The greatest coordinate of origins from where the bounds are certain.
    reach: f32,
}

/// The bounds are certain for origins within this many times the scene's greatest coordinate.
const REACH: f32 = 8.0;

impl Passable {
    /// Those of a scene, with clear walls or without; `None` if it has none.
    pub fn of(scene: &Scene, has_panes: bool) -> Option<Self> {
        let is_pane = |material: &Material| has_panes && is_pane(material);
        let is_sought = |material: &Material| scene.computes_opacity(material) || is_pane(material);
        let materials = sought_materials(scene, is_sought);
        if !materials.contains(&true) {
            return None;
        }
        let all = scene.bounds();
        let bounds = SurfaceBounds::new(scene, &all, &materials);
        let panes = scene.materials.iter().map(is_pane).collect();
        let materials = materials.into_iter().map(u32::from).collect();
        Some(Self { panes, materials, bounds, reach: all.max_abs() * REACH })
    }

    /// Lanes whose material rays may pass, or a part of it if it is a mix.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn is_of<L: Lanes>(&self, materials: Int<L>) -> Mask<L> {
        let [is_passable] = materials.rows(&self.materials);
        !is_passable.is(0)
    }

    /// True if a material that is no mix is a clear wall that rays may pass.
    #[inline]
    pub fn is_pane(&self, material: u32) -> bool {
        self.panes[material as usize]
    }

    /// Lanes whose rays may meet one of them before they end at `end` times the direction.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn lies_ahead<L: Lanes>(&self, origin: Vector<L>, direction: Vector<L>, end: Num<L>) -> Mask<L> {
        let Vector { x, y, z } = origin;
        let is_far = x.abs().max(y.abs()).max(z.abs()).above(self.reach);
        is_far | self.bounds.lies_ahead(origin, direction, end)
    }
}
