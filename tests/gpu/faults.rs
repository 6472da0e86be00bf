//! Whatever goes wrong with the GPU, the picture is the CPU's and the report says what it was.

use crate::{compare, meshes, rays, tracers};
use glam::Vec3;
use raystream::device::{AdapterChoice, Fault, Gpu};
use raystream::engine::{PreparedScene, UnitChoice, Units, UnitsError};
use raystream::film::Image;
use raystream::render::{PathTracer, Settings};
use raystream::scene::{Camera, load};
use raystream::schedule::{JobOptions, Service, ServiceOptions, Unit};
use raystream::stream::{BlockingTracer, DeviceError, Hit, Queries};
use std::path::Path;
use std::sync::Arc;

/// A picture's hash, and what the reports tell of failures.
fn render(unit: Unit, fault: Option<Fault>) -> (String, Vec<String>) {
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell.json");
    let scene = Arc::new(load::load(&scene).expect("scene"));
    let mut choice = UnitChoice::auto().with_unit(unit);
    if let Some(fault) = fault {
        choice = choice.with_fault(fault);
    }
    let units = Units::open(&choice).expect("units");
    let prepared = PreparedScene::new(scene.clone(), &units).expect("a valid scene");
    let camera = scene.camera.unwrap_or_else(|| Camera::framing(&scene.bounds(), 1.0));
    let (width, height) = (48, 48);
    let settings = Settings::new(width, height).with_spp(8).with_max_bounces(4).with_seed(3);
    let path = Arc::new(PathTracer::new(scene, &camera, settings, None).expect("settings"));
    let options = ServiceOptions::default().with_host_threads(2);
    let service = Service::new(options).expect("threads");
    let job = service.submit(path.clone(), prepared.tracers.clone(), JobOptions::default()).expect("job");
    let report = job.wait().expect("frame");
    let image = Image::new(width, height, path.film().resolve());
    (image.hash(), prepared.degraded.into_iter().chain(report.events).collect())
}

#[test]
fn every_fault_leaves_the_picture_alone_and_is_told_once() {
    let (expected, events) = render(Unit::Cpu, None);
    assert_eq!(events, [""; 0]);
    assert_eq!(render(Unit::Gpu, None), (expected.clone(), Vec::new()));
    for (unit, fault, says) in [
        (Unit::Gpu, Fault::Lost(1), "lost"),
        (Unit::Gpu, Fault::Lost(2), "lost"),
        (Unit::Gpu, Fault::Hang(2), "did not return within"),
        (Unit::Gpu, Fault::Corrupt(1), "wrong answers"),
        (Unit::Gpu, Fault::Corrupt(2), "wrong answers"),
        (Unit::Gpu, Fault::OutOfMemory, "which does not give them"),
        (Unit::Hybrid, Fault::OutOfMemory, "which does not give them"),
        (Unit::Gpu, Fault::Refused, "refused, as requested"),
        (Unit::Gpu, Fault::Inexact, "32-bit integers: "),
        (Unit::Hybrid, Fault::Inexact, "makes no exact hits"),
    ] {
        let (hash, events) = render(unit, Some(fault));
        assert_eq!(hash, expected, "{fault:?}");
        assert!(events.len() == 1 && events[0].contains(says), "{fault:?}: {events:?}");
    }
}

#[test]
fn wrong_answers_to_either_kind_of_ray_end_the_device() {
    let mesh = meshes::grid(20, 0.1, 5);
    let rays = rays::mixed(&mesh, 5000, Vec3::ZERO, 1.0, 40);
    for (closest, any) in [(5000, 0), (0, 5000), (5000, 5000), (1, 0), (0, 1)] {
        let choice = AdapterChoice { name: None, allow_software: true };
        let gpu = Gpu::open(&choice).expect("a GPU").with_fault(Fault::Corrupt(2));
        let gpu = Arc::new(gpu);
        let (oracle, tracer) = tracers(&gpu, &mesh, false);
        // A ray that hits, where one is all there is.
        let first = rays.iter().position(|ray| !oracle.closest_one(ray).is_miss()).expect("a hit");
        let pick = |count: usize| if count == 1 { &rays[first..=first] } else { &rays[..count] };
        let ask = || {
            let (rays, shadow_rays) = (pick(closest), pick(any));
            let (mut hits, mut occluded) = (vec![Hit::NONE; rays.len()], vec![0; shadow_rays.len()]);
            let queries = Queries { rays, hits: &mut hits, shadow_rays, occluded: &mut occluded };
            let answer = tracer.trace(queries);
            (hits, occluded, answer)
        };
        let (hits, occluded, answer) = ask();
        let report = answer.expect("the first dispatch is sound");
        compare("before", &oracle, pick(closest), &hits, &[]);
        compare("before", &oracle, pick(any), &[], &occluded);
        let checked = |count: usize| count.div_ceil(256).max(256).min(count) as u64;
        assert_eq!(report.checked, checked(closest) + checked(any));
        let (_, _, answer) = ask();
        let Err(DeviceError::Lost(reason)) = answer else { panic!("{closest} {any}: {answer:?}") };
        assert!(reason.contains("wrong answers"), "{reason}");
        assert_eq!(gpu.lost(), Some(reason.as_str()), "a device that lies is not asked again");
    }
}

#[test]
fn a_fault_without_a_gpu_is_refused() {
    let choice = UnitChoice::auto().with_unit(Unit::Cpu).with_fault(Fault::Lost(1));
    assert!(matches!(Units::open(&choice), Err(UnitsError::NothingToInject)));
}
