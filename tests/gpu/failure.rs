//! What goes wrong is an error value, at once.

use crate::{compare, meshes, open, rays, trace, tracers};
use glam::Vec3;
use raystream::device::{AdapterChoice, AdapterKind, Gpu, GpuError, adapters};
use raystream::stream::{BlockingTracer, DeviceError, Hit, Queries};
use raystream::trace::gpu::GpuTracer;
use std::process::Command;
use std::sync::Arc;
use std::time::{Duration, Instant};

fn ask(tracer: &GpuTracer, rays: &[raystream::stream::Ray]) -> Result<(), String> {
    let (mut hits, mut occluded) = (vec![Hit::NONE; rays.len()], vec![0; rays.len()]);
    let queries = Queries { rays, hits: &mut hits, shadow_rays: rays, occluded: &mut occluded };
    tracer.trace(queries).map(|_| ()).map_err(|error| match error {
        DeviceError::Lost(reason) => reason,
        other => panic!("{other}"),
    })
}

#[test]
fn a_lost_device_says_so_at_once_and_another_takes_its_place() {
    let gpu = open();
    let mesh = meshes::soup(200, 0.3, 1);
    let (oracle, tracer) = tracers(&gpu, &mesh, false);
    let rays = rays::mixed(&mesh, 1000, Vec3::ZERO, 1.0, 2);
    ask(&tracer, &rays).expect("the device is there");
    assert_eq!((gpu.lost(), tracer.replacements()), (None, 0));
    gpu.simulate_loss();
    let start = Instant::now();
    let first = ask(&tracer, &rays).expect_err("the device is gone");
    assert!(!first.is_empty() && start.elapsed() < Duration::from_millis(100), "calls do not wait");
    while tracer.replacements() == 0 {
        assert!(start.elapsed() < Duration::from_secs(30), "no other device");
        std::thread::sleep(Duration::from_millis(5));
    }
    let (hits, occluded, _) = trace(&tracer, &rays, &rays);
    compare("after a loss", &oracle, &rays, &hits, &occluded);
    // The device itself stays lost; whoever comes with it gets its successor, the same for all.
    assert_eq!(gpu.lost(), Some(first.as_str()));
    let bvh = Arc::new(raystream::bvh::Bvh::build(&mesh.positions, &mesh.triangles, |_| false));
    let again = GpuTracer::new(gpu, bvh, None, Arc::new(oracle)).expect("the successor takes the scene");
    assert_eq!(again.replacements(), 1);
    ask(&again, &rays).expect("it answers");
}

#[test]
fn a_loss_under_way_reaches_every_thread() {
    let gpu = open();
    let mesh = meshes::soup(2000, 0.2, 3);
    let (_, tracer) = tracers(&gpu, &mesh, false);
    let rays = rays::mixed(&mesh, 20_000, Vec3::ZERO, 1.0, 4);
    std::thread::scope(|scope| {
        let threads: Vec<_> =
            (0..3).map(|_| scope.spawn(|| (0..10_000).find_map(|_| ask(&tracer, &rays).err()))).collect();
        std::thread::sleep(Duration::from_millis(200));
        gpu.simulate_loss();
        for thread in threads {
            let end = thread.join().expect("no panic leaves the wall");
            assert!(end.is_some(), "the loss went unnoticed");
        }
    });
}

#[test]
fn another_device_can_be_opened_after_a_loss() {
    let mesh = meshes::soup(50, 0.3, 5);
    let rays = rays::mixed(&mesh, 100, Vec3::ZERO, 1.0, 6);
    for _ in 0..3 {
        let gpu = open();
        let (_, tracer) = tracers(&gpu, &mesh, false);
        ask(&tracer, &rays).expect("a fresh device answers");
        gpu.simulate_loss();
        ask(&tracer, &rays).expect_err("the device is gone");
    }
}

#[test]
fn adapters_are_found_by_name_and_a_wrong_name_lists_them() {
    let found = adapters();
    let first = found.first().expect("tests need a GPU; a software adapter will do");
    assert!(first.max_binding_bytes >= 1 << 20 && first.max_workgroups >= 65535);
    let by_name = |name: &str| Gpu::open(&AdapterChoice { name: Some(name.into()), allow_software: false });
    let upper = by_name(&first.name.to_uppercase()).expect("names are matched in any case");
    assert_eq!(upper.info().name, first.name);
    let error = by_name("no such adapter").expect_err("a wrong name").to_string();
    assert!(error.contains(&first.name), "{error}");
    if found.iter().all(|info| info.kind == AdapterKind::Software) {
        let error = Gpu::open(&AdapterChoice::default()).expect_err("hardware only").to_string();
        assert!(error.contains("software") && error.contains(&first.name), "{error}");
    }
}

/// A machine without a Vulkan driver, as the loader sees it when told to look nowhere.
#[test]
fn without_a_driver_there_is_one_clear_error_and_no_noise() {
    const CHILD: &str = "RAYSTREAM_TEST_WITHOUT_DRIVER";
    let name = "failure::without_a_driver_there_is_one_clear_error_and_no_noise";
    if std::env::var_os(CHILD).is_some() {
        assert_eq!(adapters(), []);
        let error = Gpu::open(&AdapterChoice { name: None, allow_software: true }).expect_err("no driver");
        assert!(matches!(error, GpuError::NoAdapter { .. }), "{error}");
        return;
    }
    if !cfg!(target_os = "linux") {
        return; // Elsewhere the driver is part of the system.
    }
    let child = Command::new(std::env::current_exe().expect("this test"))
        .args(["--exact", name, "--nocapture"])
        .envs(["VK_ICD_FILENAMES", "VK_DRIVER_FILES"].map(|key| (key, "/nonexistent/driver.json")))
        .env(CHILD, "1")
        .output()
        .expect("this test runs again");
    let (out, err) = (String::from_utf8_lossy(&child.stdout), String::from_utf8_lossy(&child.stderr));
    assert!(child.status.success() && out.contains("1 passed"), "{out}{err}");
    assert_eq!(err, "");
}
