//! Surfaces that scatter light by code that is not ours.

use super::harness::{self, Counts, render};
use super::path::light_sampling_agrees;
use super::scenes::*;
use crate::geom::warp::lanes as warp;
use crate::lanes::{Lanes, Num, SimdLevel, Vector};
use crate::render::{Integrator, PathTracer, Settings, Whitted};
use crate::scene::{
    Colour, Environment, Material, Points, Scattered, Scattering, ScatteringSurface, Scene, Surface,
};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;
use std::sync::Arc;

/// What `Surface::Matte` is.
#[derive(Debug)]
struct Plaster(Vec3);

impl Scattering for Plaster {
    #[inline(always)]
    fn evaluate<L: Lanes>(&self, at: &Points<L>, _: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let colour = Vector::splat(at.position.lanes(), self.0);
        (colour * (wi.z.clamp(0.0, 1.0) * FRAC_1_PI), warp::cosine_hemisphere_pdf(wi.z))
    }

    #[inline(always)]
    fn sample<L: Lanes>(&self, _: &Points<L>, wo: Vector<L>, _: Num<L>, u2: [Num<L>; 2]) -> Scattered<L> {
        let wi = warp::cosine_hemisphere(u2);
        let weight = Vector::splat(wo.lanes(), self.0);
        Scattered { wi, weight, pdf: warp::cosine_hemisphere_pdf(wi.z) }
    }
}

/// White, and a third of the light goes through.
#[derive(Debug)]
struct Paper;

impl Scattering for Paper {
    #[inline(always)]
    fn evaluate<L: Lanes>(&self, _: &Points<L>, _: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let l = wi.lanes();
        let share = Num::select(wi.z.above(0.0), Num::splat(l, 2.0), Num::splat(l, 1.0)) / 3.0;
        let value = wi.z.abs() * share * FRAC_1_PI;
        (Vector::grey(value), value)
    }

    #[inline(always)]
    fn sample<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, u: Num<L>, u2: [Num<L>; 2]) -> Scattered<L> {
        let up = warp::cosine_hemisphere(u2);
        let wi = Vector::select(u.below(2.0 / 3.0), up, Vector::new(up.x, up.y, -up.z));
        Scattered::evaluated(wi, self.evaluate(at, wo, wi))
    }

    fn transmits(&self) -> bool {
        true
    }
}

/// The surface of code.
fn coded(scene: &mut Scene, surface: impl Scattering) -> Surface {
    scene.scatterings.push(ScatteringSurface::new(surface));
    Surface::Scattering(scene.scatterings.len() as u32 - 1)
}

const SETTINGS: Settings = Settings::new(24, 24).with_spp(16).with_max_bounces(3);

fn picture<I: Integrator + crate::schedule::Renderer>(made: &I) -> (Vec<[f32; 3]>, Counts) {
    let counts = render(made, 8192, &harness::tracer(made.frame().scene()));
    (made.frame().film().resolve(), counts)
}

#[test]
fn matte_written_anew_has_the_same_bytes_with_every_integrator_and_instruction_set() {
    let ours = room();
    let mut theirs = ours.clone();
    for i in 0..theirs.materials.len() {
        if let Surface::Matte { reflectance: Colour { factor, .. } } = theirs.materials[i].surface {
            theirs.materials[i].surface = coded(&mut theirs, Plaster(factor));
        }
    }
    assert!(theirs.scatterings.len() > 1);
    assert_ne!(ours.fingerprint(), theirs.fingerprint());
    let scenes = [Arc::new(ours), Arc::new(theirs)];
    for simd in SimdLevel::available() {
        let path =
            |scene: &Arc<Scene>| PathTracer::new(scene.clone(), &camera(), SETTINGS, None).expect("valid");
        let [ours, theirs] = scenes.each_ref().map(|scene| picture(&path(scene).with_simd(simd)));
        assert_eq!(ours, theirs, "{simd}");
        let whitted = |scene: &Arc<Scene>| Whitted::new(scene.clone(), &camera(), SETTINGS).expect("valid");
        let [ours, theirs] = scenes.each_ref().map(|scene| picture(&whitted(scene).with_simd(simd)));
        assert_eq!(ours, theirs, "{simd}");
    }
}

#[test]
fn what_lets_light_through_is_lit_from_both_sides() {
    let mut scene = room();
    let paper = coded(&mut scene, Paper);
    let sheet = add_material(&mut scene, of(paper));
    add_quad(&mut scene, Vec3::new(-1.0, 1.2, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0, sheet);
    light_sampling_agrees(&scene);
}

#[test]
fn a_white_body_of_paper_vanishes_in_a_white_furnace() {
    let mut scene = furnace(Material::fallback(), 2, false);
    scene.environment = Environment::Constant(Vec3::ONE);
    scene.materials[0].surface = coded(&mut scene, Paper);
    let settings = Settings { spp: 64, max_bounces: 60, ..SETTINGS };
    let path = PathTracer::new(Arc::new(scene.clone()), &camera(), settings, None).expect("valid");
    render(&path, 8192, &harness::tracer(&scene));
    let off = path.film().resolve().into_iter().map(|p| (Vec3::from(p) - 1.0).abs().max_element());
    assert!(off.fold(0.0, f32::max) < 1e-3);
}
