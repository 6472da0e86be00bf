//! Jobs that borrow their renderers.

use super::super::{JobError, JobOptions, Service, Tracers};
use super::gated::{Held, Holder};
use super::ledger::{Ledger, Script};
use super::{Gated, SCRIPT, SMALL, blind, service, wait_until};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// Whether the renderer's owner may have ended.
struct IsOver<'a>(&'a AtomicBool);

impl Held for IsOver<'_> {
    fn check(&self) {
        assert!(!self.0.load(Relaxed), "no renderer is called after its scope");
    }
}

#[test]
fn jobs_borrow_from_the_stack() {
    let service = service(2, false);
    let ledgers = [1, 2, 3].map(|seed| Ledger::new(Script { seed, ..SCRIPT }));
    let tracers = |ledger: &Arc<Ledger>| Tracers::cpu(Arc::clone(ledger) as _);
    let camera_rays: u64 = service.scope(|scope| {
        let jobs = ledgers.each_ref().map(|ledger| scope.submit(&**ledger, tracers(ledger), SMALL).unwrap());
        jobs.map(|job| job.wait().unwrap().rays.camera).iter().sum()
    });
    assert_eq!(ledgers.map(|ledger| ledger.check_complete()[0]).iter().sum::<u64>(), camera_rays);
}

/// Ends a scope's closure with a job under way, in some way, while the job waits at its gate.
fn leave(service: &Service, end: impl Fn(super::super::JobHandle)) -> u64 {
    let gated = Gated::new();
    let is_over = AtomicBool::new(false);
    {
        let borrower = Holder { gated: &*gated, held: IsOver(&is_over) };
        service.scope(|scope| {
            let job = scope.submit(&borrower, blind(), JobOptions::default()).unwrap();
            wait_until(|| gated.spawned.load(Relaxed) > 0);
            let opener = Arc::clone(&gated);
            std::thread::spawn(move || {
                std::thread::sleep(std::time::Duration::from_millis(5));
                opener.open();
            });
            end(job);
        });
    }
    is_over.store(true, Relaxed);
    gated.shaded.load(Relaxed)
}

#[test]
fn every_job_is_over_before_its_scope_returns() {
    let service = service(1, false);
    assert_eq!(leave(&service, std::mem::forget), 50);
    assert_eq!(leave(&service, super::super::JobHandle::detach), 50);
    assert!(leave(&service, drop) <= 1, "dropping the handle cancels");
    let panicked = catch_unwind(AssertUnwindSafe(|| {
        leave(&service, |job| {
            std::mem::forget(job);
            resume_unwind(Box::new("a closure that panics"));
        })
    }));
    assert_eq!(*panicked.unwrap_err().downcast::<&str>().unwrap(), "a closure that panics");
    assert_eq!(service.scope(|_| 7), 7);
}

#[test]
fn a_panic_cancels_what_the_scope_has_submitted() {
    let service = service(1, false);
    let endless = Gated::with_tiles(u64::MAX);
    endless.open();
    let panicked = catch_unwind(AssertUnwindSafe(|| {
        service.scope(|scope| {
            scope.submit(&*endless, blind(), JobOptions::default()).unwrap().detach();
            resume_unwind(Box::new(()));
        })
    }));
    assert!(panicked.is_err(), "and the scope returns");
}

#[test]
fn a_handle_may_outlive_its_scope() {
    let service = service(1, false);
    let gated = Gated::new();
    let job = service.scope(|scope| {
        gated.open();
        scope.submit(&*gated, blind(), JobOptions::default()).unwrap()
    });
    assert_eq!(job.wait().unwrap().tiles_spawned, 50);
    let cancelled = service.scope(|scope| {
        let job = scope.submit(&*gated, blind(), JobOptions::default()).unwrap();
        job.cancel();
        job
    });
    assert!(matches!(cancelled.wait(), Err(JobError::Cancelled) | Ok(_)));
}
