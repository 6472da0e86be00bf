//! The plain renderer beside the tests' own driver: the same shaders, the same picture.

use super::harness::{self, Counts};
use super::scenes::*;
use crate::render::{PathTracer, RayByRay, Settings, Whitted, render_single_rays};
use crate::scene::Surface;
use crate::schedule::{RayCounts, Renderer};
use glam::Vec3;
use std::sync::Arc;

/// Four tiles, so that several threads have one each and all help with the last.
const SETTINGS: Settings = Settings::new(200, 140).with_spp(2).with_max_bounces(3).with_seed(5);

fn counts(rays: RayCounts) -> Counts {
    Counts { camera: rays.camera, continuation: rays.continuation, shadow: rays.shadow }
}

#[test]
fn every_number_of_threads_gives_the_picture_of_batches() {
    let scene = Arc::new(room());
    let tracer = harness::tracer(&scene);
    let path = || PathTracer::new(scene.clone(), &camera(), SETTINGS, None).expect("valid settings");
    let batches = path();
    let expected = harness::render(&batches, 8192, &tracer);
    assert!(expected.continuation > 1000 && expected.shadow > 1000);
    for threads in 1..=4 {
        let single = path();
        assert_eq!(counts(render_single_rays(&single, &tracer, threads)), expected);
        assert!(single.film().resolve() == batches.film().resolve(), "{threads} threads");
    }
    let inner = Arc::new(path());
    assert_eq!(harness::render(&RayByRay(inner.clone()), 8192, &tracer), expected);
    assert!(inner.film().resolve() == batches.film().resolve());
}

#[test]
fn loop_shaders_work_with_batches_of_one() {
    let scene = Arc::new(sheets(6, of(Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE })));
    let tracer = harness::tracer(&scene);
    let whitted = || Whitted::new(scene.clone(), &camera(), SETTINGS).expect("valid settings");
    let (batches, single) = (whitted(), whitted());
    let expected = harness::render(&batches, 8192, &tracer);
    assert_eq!(counts(render_single_rays(&single, &tracer, 3)), expected);
    assert!(single.film().resolve() == batches.film().resolve());
    assert_eq!(single.loop_stack().live_entries, 0);
    assert!(single.tiles() >= 4);
}

#[test]
fn wrapping_a_renderer_keeps_its_bound_on_paths() {
    let scene = Arc::new(room());
    let whitted = Arc::new(Whitted::new(scene, &camera(), SETTINGS).expect("valid settings"));
    let most = whitted.most_in_flight();
    assert!(most < usize::MAX, "the loop stack bounds the paths in flight");
    assert_eq!(RayByRay(whitted).most_in_flight(), most);
}
