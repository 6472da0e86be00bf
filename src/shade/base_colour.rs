//! Base colours of surfaces, for layers of pictures.

use super::{Interaction, lookup};
use crate::lanes::{Lanes, Vector};
use crate::scene::{Material, Scene, Surface};
use glam::Vec3;

/// The base colours of surfaces of one material, 0..=1: the albedo of diffuse surfaces, the reflectance of mirrors and
/// metals at normal incidence, and the share of light that passes a smooth dielectric boundary. The base colour of
/// unlit surfaces is their radiance. A surface whose BSDF is user code is white.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn base_colour<L: Lanes>(scene: &Scene, material: &Material, at: &Interaction<L>) -> Vector<L> {
    let l = at.wo.lanes();
    if let Some(unlit) = material.emission.filter(|emission| !emission.is_light) {
        return lookup::albedo(scene, &unlit.radiance, &at.texture);
    }
    match &material.surface {
        Surface::Matte { reflectance: colour } | Surface::Mirror { reflectance: colour } => {
            lookup::albedo(scene, colour, &at.texture)
        }
        Surface::Principled(surface) => lookup::albedo(scene, &surface.base_colour, &at.texture),
        Surface::OpenPbr(surface) => {
            let base = lookup::albedo(scene, &surface.base_color, &at.texture)
                * lookup::share(scene, &surface.base_weight, &at.texture);
            match &surface.subsurface {
                Some(of) => {
                    base.lerp(Vector::splat(l, of.color), lookup::share(scene, &of.weight, &at.texture))
                }
                None => base,
            }
        }
        Surface::Dielectric { transmittance, .. } => {
            Vector::splat(l, transmittance.clamp(Vec3::ZERO, Vec3::ONE))
        }
        Surface::Procedural(index) => {
            let finish = match at.finish {
                Some(finish) => finish,
                None => scene.procedurals[*index as usize].finish(&at.points(scene)),
            };
            finish.colour.clamp(0.0, 1.0)
        }
        Surface::Scattering(_) | Surface::Mix(_) => Vector::splat(l, Vec3::ONE),
    }
}
