//! Splats that are dropped are known by the material that made them.

use super::harness::{render, tracer};
use super::scenes::*;
use crate::geom::warp::lanes as warp;
use crate::lanes::{Lanes, Num, SimdLevel, Vector};
use crate::render::{Dropped, Integrator, PathTracer, Settings, Whitted};
use crate::scene::{Points, Scattered, Scattering, ScatteringSurface, Scene};
use glam::Vec3;
use std::sync::Arc;

const SETTINGS: Settings = Settings::new(32, 24).with_spp(4).with_max_bounces(4).with_seed(3);

/// A BSDF that is not a number where x is positive, and white elsewhere.
#[derive(Debug)]
struct Broken;

impl Scattering for Broken {
    #[inline(always)]
    fn evaluate<L: Lanes>(&self, at: &Points<L>, _: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let nan = Num::splat(wi.lanes(), f32::NAN);
        let value = Num::select(at.position.x.above(0.0), nan, wi.z.clamp(0.0, 1.0));
        (Vector::grey(value), warp::cosine_hemisphere_pdf(wi.z))
    }

    #[inline(always)]
    fn sample<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, _: Num<L>, u2: [Num<L>; 2]) -> Scattered<L> {
        let wi = warp::cosine_hemisphere(u2);
        Scattered::evaluated(wi, self.evaluate(at, wo, wi))
    }
}

/// A room with a broken floor, and the floor's number.
fn broken_room() -> (Arc<Scene>, u32) {
    let mut scene = room();
    let surface = scene.add_surface(ScatteringSurface::new(Broken));
    let floor = scene.mesh.materials[0];
    scene.materials[floor as usize].surface = surface;
    scene.materials[floor as usize].name = "floor".into();
    (Arc::new(scene), floor)
}

/// Renders, and checks what was dropped.
fn check<I: Integrator + crate::schedule::Renderer>(integrator: &I, scene: &Scene, broken: u32) -> Dropped {
    render(integrator, 8192, &tracer(scene));
    let frame = integrator.frame();
    let dropped = frame.dropped_by_material();
    assert_eq!(dropped.keys().collect::<Vec<_>>(), [&Some(broken)], "no other material is to blame");
    let dropped = dropped[&Some(broken)];
    assert_eq!(dropped.splats, frame.film().dropped_splats());
    assert!(frame.film().resolve().iter().flatten().all(|channel| channel.is_finite()));
    dropped
}

#[test]
fn the_material_that_made_them_and_the_first_pixel_are_known_at_every_instruction_set() {
    let (scene, floor) = broken_room();
    let path = |simd| {
        let path =
            PathTracer::new(scene.clone(), &camera(), SETTINGS, Some(2)).expect("valid").with_simd(simd);
        let dropped = check(&path, &scene, floor);
        let [warning] = <[String; 1]>::try_from(path.frame().dropped_warnings()).expect("one material");
        let (x, y) = (dropped.first_pixel % 32, dropped.first_pixel / 32);
        let expected = format!(
            "dropped {} splats of material \"floor\" that were negative or not finite; the first at column {x}, \
             row {y}",
            dropped.splats
        );
        assert_eq!(warning, expected);
        dropped
    };
    let found: Vec<Dropped> = SimdLevel::available().into_iter().map(path).collect();
    assert!(found.iter().all(|dropped| *dropped == found[0]) && found[0].splats > 100, "{found:?}");
    let whitted = Whitted::new(scene.clone(), &camera(), SETTINGS).expect("valid");
    check(&whitted, &scene, floor);
}

#[test]
fn films_of_sound_scenes_drop_nothing() {
    let scene = Arc::new(one_of_everything());
    let path = PathTracer::new(scene.clone(), &camera(), SETTINGS, Some(2)).expect("valid");
    render(&path, 8192, &tracer(&scene));
    assert!(path.frame().dropped_warnings().is_empty());
    path.frame().splat(None, 33, Vec3::NAN);
    let warnings = path.frame().dropped_warnings();
    assert!(
        warnings[0].contains("no known material") && warnings[0].ends_with("column 1, row 1"),
        "{warnings:?}"
    );
}
