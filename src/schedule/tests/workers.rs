//! Host threads that are the workers of a rayon pool.

use super::super::{JobOptions, Service, ServiceOptions, ThreadKind, Tracers};
use super::ledger::{Ledger, Script, mix};
use super::{Gated, SCRIPT, SMALL, blind, outcome, wait_until};
use rayon::prelude::*;
use std::collections::HashSet;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex};

fn pooled(workers: usize) -> (Arc<rayon::ThreadPool>, Service) {
    let name = |index| format!("worker {index}");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(workers).thread_name(name).build();
    let pool = Arc::new(pool.unwrap());
    let options = ServiceOptions::default().with_device_thread(true).with_rayon_pool(Arc::clone(&pool));
    let service = Service::new(options).unwrap();
    (pool, service)
}

fn run(service: &Service, seed: u64) {
    let ledger = Ledger::new(Script { seed, ..SCRIPT });
    let job = service.submit(Arc::clone(&ledger), Tracers::cpu(Arc::clone(&ledger) as _), SMALL).unwrap();
    let report = outcome(job).unwrap();
    ledger.check_complete();
    let hosts = report.threads.iter().filter(|thread| thread.kind == ThreadKind::Host);
    assert_eq!(hosts.count(), service.host_threads());
}

#[test]
fn jobs_run_on_the_pools_workers_and_leave_them_free() {
    for workers in [1, 3] {
        let (pool, service) = pooled(workers);
        assert_eq!(service.host_threads(), workers);
        (0..20).for_each(|seed| run(&service, seed));
        // All workers meet here, so none of them is the service's.
        let names = Mutex::new(HashSet::new());
        pool.broadcast(|_| names.lock().unwrap().insert(std::thread::current().name().unwrap().to_owned()));
        assert_eq!(names.into_inner().unwrap().len(), workers);
    }
}

#[test]
fn rayons_work_goes_on_beside_an_endless_job() {
    let (pool, service) = pooled(2);
    let endless = Gated::with_tiles(u64::MAX);
    endless.open();
    let job = service.submit(Arc::clone(&endless), blind(), JobOptions::default()).unwrap();
    wait_until(|| endless.shaded.load(Relaxed) > 0);
    for round in 0..20_u64 {
        let sum: u64 = pool.install(|| (0..10_000_u64).into_par_iter().map(|i| mix(i) % 2 + round).sum());
        assert!(sum >= 10_000 * round);
    }
    job.cancel();
    assert!(outcome(job).is_err());
}

#[test]
fn workers_may_wait_for_jobs() {
    for workers in [1, 2] {
        let (pool, service) = pooled(workers);
        pool.install(|| (0..8_u64).into_par_iter().for_each(|seed| run(&service, seed)));
        // Even while another job never ends.
        let endless = Gated::with_tiles(u64::MAX);
        endless.open();
        let job = service.submit(Arc::clone(&endless), blind(), JobOptions::default()).unwrap();
        pool.install(|| run(&service, 9));
        let ledger = Ledger::new(SCRIPT);
        let tracers = Tracers::cpu(Arc::clone(&ledger) as _);
        pool.install(|| {
            service.scope(|scope| scope.submit(&*ledger, tracers, SMALL).unwrap().wait().unwrap())
        });
        ledger.check_complete();
        // And drop the service.
        pool.install(|| drop(service));
        assert!(outcome(job).is_err());
    }
}

#[test]
fn two_services_share_a_pool() {
    let (pool, first) = pooled(2);
    let second = Service::new(ServiceOptions::default().with_rayon_pool(pool)).unwrap();
    std::thread::scope(|scope| {
        for service in [&first, &second] {
            scope.spawn(move || (0..50).for_each(|seed| run(service, seed)));
        }
    });
}
