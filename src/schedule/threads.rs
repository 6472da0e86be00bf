//! Tests of the service with real threads.

use super::ledger::{FakeDevice, Fate, Ledger, Script};
use super::{JobOptions, Service, ServiceOptions, Tracers, Unit};
use std::sync::Arc;
use std::time::Duration;

const SCRIPT: Script =
    Script { seed: 1, tiles: 40, tile_rays: 300, max_depth: 6, shadow_rays_per_ray: 2, panic_at: None };

const SMALL: JobOptions = JobOptions {
    in_flight: Some(3000),
    threshold: Some(400),
    batch_rays: 200,
    chunk_rays: 64,
    chunk_rays_most: 500,
    policy: None,
    timeline: true,
};

fn service(host_threads: usize, dispatch_threads: usize) -> Service {
    let options = ServiceOptions { host_threads, dispatch_threads, max_jobs: 3, ..Default::default() };
    Service::new(options).unwrap()
}

fn device(ledger: &Arc<Ledger>, fate: Fate) -> Arc<FakeDevice> {
    let (max_rays, delay) = (250, Duration::ZERO);
    Arc::new(FakeDevice { ledger: Arc::clone(ledger), fate, max_rays, delay, dispatches: Default::default() })
}

fn tracers(ledger: &Arc<Ledger>, device: Arc<FakeDevice>, unit: Unit) -> Tracers {
    Tracers { host: Arc::clone(ledger) as _, device: Some(device), unit }
}

#[test]
fn every_ray_is_shaded_once_with_any_number_of_threads() {
    for hosts in 1..=8 {
        for unit in [Unit::Cpu, Unit::Gpu, Unit::Hybrid] {
            let service = service(hosts, 2);
            let ledger = Ledger::new(SCRIPT);
            let tracers = tracers(&ledger, device(&ledger, Fate::Lives), unit);
            let job = service.submit(Arc::clone(&ledger), tracers, SMALL).unwrap();
            let report = job.wait().unwrap();
            let [camera, continuation, shadow] = ledger.check_complete();
            assert_eq!(
                [report.rays.camera, report.rays.continuation, report.rays.shadow],
                [camera, continuation, shadow]
            );
            assert!(report.max_in_flight <= 3000 && !report.stopped && report.events.is_empty());
            match unit {
                Unit::Cpu => assert_eq!(report.gpu.rays, 0),
                Unit::Gpu => assert_eq!(report.cpu.rays, 0),
                Unit::Hybrid => assert!(report.gpu.rays > 0),
            }
            assert_eq!(report.threads.len(), hosts + 2);
        }
    }
}

#[test]
fn a_device_that_dies_costs_nothing_but_time() {
    for fate in [Fate::Lost(0), Fate::Lost(3), Fate::Panics(0), Fate::Panics(5)] {
        for unit in [Unit::Gpu, Unit::Hybrid] {
            let service = service(2, 2);
            let ledger = Ledger::new(SCRIPT);
            let device = Arc::new(FakeDevice {
                max_rays: 10_000,
                delay: Duration::ZERO,
                ..Arc::into_inner(device(&ledger, fate)).unwrap()
            });
            let job = service.submit(Arc::clone(&ledger), tracers(&ledger, device, unit), SMALL).unwrap();
            let report = job.wait().unwrap();
            ledger.check_complete();
            assert_eq!(report.events.len(), 1, "one event: {:?}", report.events);
            assert!(report.events[0].starts_with("a fake device failed ("), "{:?}", report.events);
            assert!(report.cpu.rays > 0);
        }
    }
}

#[test]
fn a_slow_device_is_helped() {
    let service = service(2, 1);
    let ledger = Ledger::new(SCRIPT);
    let device = Arc::new(FakeDevice {
        delay: Duration::from_millis(5),
        ..Arc::into_inner(device(&ledger, Fate::Lives)).unwrap()
    });
    let tracers = tracers(&ledger, device, Unit::Hybrid);
    let report = service.submit(Arc::clone(&ledger), tracers, SMALL).unwrap().wait().unwrap();
    ledger.check_complete();
    assert!(report.cpu.rays > report.gpu.rays && report.gpu.rays > 0);
}

#[test]
fn without_a_device_or_its_threads_the_host_traces_and_says_so() {
    let ledger = Ledger::new(SCRIPT);
    let no_device = Tracers { unit: Unit::Gpu, ..Tracers::cpu(Arc::clone(&ledger) as _) };
    let report = service(1, 1).submit(Arc::clone(&ledger), no_device, SMALL).unwrap().wait().unwrap();
    assert_eq!(report.events, ["there is no GPU; host threads trace alone"]);
    let ledger = Ledger::new(SCRIPT);
    let tracers = tracers(&ledger, device(&ledger, Fate::Lives), Unit::Gpu);
    let report = service(1, 0).submit(Arc::clone(&ledger), tracers, SMALL).unwrap().wait().unwrap();
    assert_eq!(report.events, ["a fake device is not used: the service has no dispatch threads"]);
    assert_eq!(report.gpu.rays, 0);
    ledger.check_complete();
}
