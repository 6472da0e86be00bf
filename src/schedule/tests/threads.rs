//! The service with real threads, and with devices that live, are slow or die.

use super::super::{JobError, Policy, TaskKind, ThreadKind, Tracers, Unit};
use super::ledger::{FakeDevice, Fate, Ledger, Script, mix};
use super::{SCRIPT, SMALL, outcome, service, wait_until};
use crate::stream::{DeviceError, DeviceState, DeviceStream, DeviceTracer, Resolve, Ticket};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::Duration;

fn device(ledger: &Arc<Ledger>, fate: Fate) -> Arc<FakeDevice> {
    let (bundle_rays, patience, delay) = (1500, 1, Duration::ZERO);
    let (ledger, counts) = (Arc::clone(ledger), Arc::default());
    Arc::new(FakeDevice { ledger, fate, bundle_rays, patience, delay, ready_after: 0, counts })
}

fn tracers(ledger: &Arc<Ledger>, device: Arc<FakeDevice>, unit: Unit) -> Tracers {
    Tracers::cpu(Arc::clone(ledger) as _).with_device(device, unit)
}

#[test]
fn every_ray_is_shaded_once_with_any_number_of_threads() {
    for hosts in 1..=8 {
        for unit in [Unit::Cpu, Unit::Gpu, Unit::Hybrid] {
            let service = service(hosts, true);
            let ledger = Ledger::new(SCRIPT);
            let tracers = tracers(&ledger, device(&ledger, Fate::Lives), unit);
            let job = service.submit(Arc::clone(&ledger), tracers, SMALL).unwrap();
            let report = outcome(job).unwrap();
            let [camera, continuation, shadow] = ledger.check_complete();
            assert_eq!(
                [report.rays.camera, report.rays.continuation, report.rays.shadow],
                [camera, continuation, shadow]
            );
            assert!(report.max_in_flight <= 3000 && !report.stopped && report.events.is_empty());
            match unit {
                Unit::Cpu => assert_eq!(report.gpu.rays, 0),
                Unit::Gpu => assert_eq!(report.cpu.rays, 0),
                Unit::Hybrid => assert_eq!(report.cpu.rays + report.gpu.rays, report.rays.total()),
            }
            assert_eq!(report.threads.len(), hosts + 1);
        }
    }
}

#[test]
fn a_device_that_dies_costs_nothing_but_time() {
    let fates = (0..10).map(|case| Fate::any(case / 2, case % 2 * 3));
    for fate in fates {
        for unit in [Unit::Gpu, Unit::Hybrid] {
            let service = service(2, true);
            let ledger = Ledger::new(SCRIPT);
            let tracers = tracers(&ledger, device(&ledger, fate), unit);
            let job = service.submit(Arc::clone(&ledger), tracers, SMALL).unwrap();
            let report = outcome(job).unwrap();
            ledger.check_complete();
            // Host threads that help may be done before the device has had its first chance, or its last.
            let helped = unit == Unit::Hybrid;
            assert!(report.events.len() == 1 || (helped && report.events.is_empty()), "{:?}", report.events);
            assert!(report.events.iter().all(|event| event.starts_with("a fake device failed (")));
            assert!(report.cpu.rays > 0);
        }
    }
}

#[test]
fn a_slow_device_is_helped() {
    let service = service(2, true);
    let ledger = Ledger::new(SCRIPT);
    let device = Arc::new(FakeDevice {
        delay: Duration::from_millis(5),
        ..Arc::into_inner(device(&ledger, Fate::Lives)).unwrap()
    });
    let tracers = tracers(&ledger, device, Unit::Hybrid);
    let report = outcome(service.submit(Arc::clone(&ledger), tracers, SMALL).unwrap()).unwrap();
    ledger.check_complete();
    assert!(report.cpu.rays > report.gpu.rays);
}

/// A device that answers when it may, and is ready when it may.
struct Late {
    device: Arc<FakeDevice>,
    may_answer: Arc<AtomicBool>,
    state: Arc<Mutex<DeviceState>>,
}

struct LateTicket {
    ticket: Box<dyn Ticket>,
    may_answer: Arc<AtomicBool>,
}

impl DeviceTracer for Late {
    fn name(&self) -> &str {
        self.device.name()
    }

    fn bundle_rays(&self) -> Option<usize> {
        self.device.bundle_rays()
    }

    fn state(&self) -> DeviceState {
        self.state.lock().unwrap().clone()
    }

    fn submit(&self, bundle: Vec<DeviceStream>) -> Result<Box<dyn Ticket>, DeviceError> {
        assert_eq!(self.state(), DeviceState::Ready);
        let ticket = self.device.submit(bundle)?;
        Ok(Box::new(LateTicket { ticket, may_answer: Arc::clone(&self.may_answer) }))
    }
}

impl Ticket for LateTicket {
    fn wait(&mut self, timeout: Duration) -> Result<Option<Vec<Box<dyn Resolve>>>, DeviceError> {
        if !self.may_answer.load(Relaxed) {
            std::thread::sleep(timeout.min(Duration::from_millis(1)));
            return Ok(None);
        }
        self.ticket.wait(timeout)
    }
}

#[test]
fn no_frame_waits_for_a_device_that_is_later_than_host_threads() {
    for fate in [Fate::Lives, Fate::Lost(0)] {
        let service = service(2, true);
        let may_answer = Arc::new(AtomicBool::new(false));
        let frame = |policy| {
            let ledger = Ledger::new(SCRIPT);
            let (device, may_answer) = (device(&ledger, fate), Arc::clone(&may_answer));
            let tracers = Tracers::cpu(Arc::clone(&ledger) as _)
                .with_device(Arc::new(Late { device, may_answer, state: Arc::default() }), Unit::Hybrid);
            let job = service.submit(Arc::clone(&ledger), tracers, SMALL.with_policy(policy)).unwrap();
            (ledger, job)
        };
        // The second frame finds the device busy with what the first has left.
        for policy in Policy::ALL {
            let (ledger, job) = frame(policy);
            let report = outcome(job).unwrap();
            ledger.check_complete();
            assert_eq!((report.gpu.rays, report.cpu.rays), (0, report.rays.total()));
            assert!(report.events.is_empty(), "{:?}", report.events);
        }
        let (_, cancelled) = frame(Policy::RayAccelerator);
        cancelled.cancel();
        drop(outcome(cancelled));
        may_answer.store(true, Relaxed);
        let (ledger, job) = frame(Policy::RayAccelerator);
        outcome(job).unwrap();
        ledger.check_complete();
    }
}

#[test]
fn a_device_joins_when_it_is_ready_or_is_told_of() {
    let service = service(2, true);
    let run = |unit, then: Option<DeviceState>| {
        let ledger = Ledger::new(Script { tiles: 4000, ..SCRIPT });
        let state = Arc::new(Mutex::new(DeviceState::Opening));
        let late = Late {
            device: device(&ledger, Fate::Lives),
            may_answer: Arc::new(AtomicBool::new(true)),
            state: Arc::clone(&state),
        };
        let tracers = Tracers::cpu(Arc::clone(&ledger) as _).with_device(Arc::new(late), unit);
        let options = SMALL.with_policy(Policy::RayAccelerator);
        let job = service.submit(Arc::clone(&ledger), tracers, options).unwrap();
        if let Some(then) = then {
            wait_until(|| job.progress().tiles_spawned > 100);
            *state.lock().unwrap() = then;
        }
        let report = outcome(job).unwrap();
        ledger.check_complete();
        report
    };
    for unit in [Unit::Gpu, Unit::Hybrid] {
        let report = run(unit, None);
        assert_eq!((report.gpu.rays, report.events.len()), (0, 0));
        let report = run(unit, Some(DeviceState::Ready));
        assert!(report.gpu.rays > 0 && report.cpu.rays > 0 && report.events.is_empty());
        let report = run(unit, Some(DeviceState::Unavailable("it has no memory".to_owned())));
        assert_eq!(report.gpu.rays, 0);
        assert_eq!(
            report.events,
            ["a fake device cannot be used (it has no memory); host threads trace alone"]
        );
    }
}

#[test]
fn without_a_device_or_its_thread_the_host_traces_and_says_so() {
    let ledger = Ledger::new(SCRIPT);
    let no_device = Tracers { unit: Unit::Gpu, ..Tracers::cpu(Arc::clone(&ledger) as _) };
    let report = outcome(service(1, true).submit(Arc::clone(&ledger), no_device, SMALL).unwrap()).unwrap();
    assert_eq!(report.events, ["there is no GPU; host threads trace alone"]);
    let ledger = Ledger::new(SCRIPT);
    let tracers = tracers(&ledger, device(&ledger, Fate::Lives), Unit::Gpu);
    let report = outcome(service(1, false).submit(Arc::clone(&ledger), tracers, SMALL).unwrap()).unwrap();
    assert_eq!(report.events, ["a fake device is not used: the service has no device thread"]);
    assert_eq!(report.gpu.rays, 0);
    ledger.check_complete();
}

#[test]
fn the_account_adds_up() {
    let service = service(2, true);
    let ledger = Ledger::new(SCRIPT);
    let tracers = tracers(&ledger, device(&ledger, Fate::Lives), Unit::Hybrid);
    let job = service.submit(Arc::clone(&ledger), tracers, SMALL).unwrap();
    let report = outcome(job).unwrap();
    assert_eq!(report.cpu.rays + report.gpu.rays, report.rays.total());
    assert!(
        report.gpu.bytes_copied > 0 && report.gpu.flagged > 0 && report.gpu.retraced == report.gpu.flagged
    );
    assert!((0.0..=1.0).contains(&report.tail_idle_share));
    let seconds = |kind: TaskKind| -> f64 {
        let tasks = report.timeline.iter().filter(|task| task.kind == kind);
        tasks.map(|task| (task.end_ns - task.start_ns) as f64 * 1e-9).sum()
    };
    assert!((seconds(TaskKind::Trace) - report.cpu.busy_s).abs() < 1e-6);
    assert!((seconds(TaskKind::Dispatch) - report.gpu.busy_s).abs() < 1e-6);
    // CPU time, which is at most that of the clock.
    assert!(report.gpu.resolving_s > 0.0 && report.gpu.resolving_s < seconds(TaskKind::Resolve) + 1e-6);
    assert!(report.gpu.sending_s > 0.0 && report.gpu.waiting_s >= report.gpu.busy_s);
    assert_eq!(report.shading.rays, report.rays.total());
    for (index, thread) in report.threads.iter().enumerate() {
        assert!(thread.busy_s + thread.idle_s <= report.wall_s * 1.001, "{report:?}");
        assert_eq!(thread.kind, if index < 2 { ThreadKind::Host } else { ThreadKind::Device });
        let mut tasks: Vec<_> = report.timeline.iter().filter(|task| task.thread as usize == index).collect();
        tasks.sort_by_key(|task| task.start_ns);
        assert!(tasks.windows(2).all(|pair| pair[0].end_ns <= pair[1].start_ns), "one task at a time");
        assert!(tasks.iter().all(|task| task.end_ns as f64 * 1e-9 <= report.wall_s + 1e-9));
    }
    let spawned: u64 =
        report.timeline.iter().filter(|t| t.kind == TaskKind::Spawn).map(|t| u64::from(t.rays)).sum();
    assert!(spawned >= report.rays.camera && spawned <= report.rays.camera + report.rays.shadow);
}

#[test]
fn streams_serve_the_next_frame() {
    let service = service(2, false);
    let streams = |tiles| {
        let ledger = Ledger::new(Script { tiles, ..SCRIPT });
        let tracers = Tracers::cpu(Arc::clone(&ledger) as _);
        let report = outcome(service.submit(Arc::clone(&ledger), tracers, SMALL).unwrap()).unwrap();
        ledger.check_complete();
        report.streams
    };
    let made = streams(40);
    assert!(made >= 2);
    assert_eq!([streams(0), streams(1)], [made, made], "those of the frame before");
    service.free_streams();
    assert_eq!(streams(0), 0);
}

#[test]
fn many_owners_submit_cancel_and_drop_at_once() {
    let service = service(3, true);
    let run = |owner: u64| {
        let mut kept = 0;
        for round in 0..40 {
            let random = mix(owner << 32 | round);
            let panic_at = random.is_multiple_of(7).then_some(random % 40);
            let script = Script { seed: random, tiles: 12, panic_at, ..SCRIPT };
            let ledger = Ledger::new(script);
            let is_sound = (random / 8).is_multiple_of(3);
            let fate = if is_sound { Fate::Lives } else { Fate::any(random / 16, random / 128 % 3) };
            let unit = [Unit::Cpu, Unit::Gpu, Unit::Hybrid][random as usize / 32 % 3];
            let tracers = tracers(&ledger, device(&ledger, fate), unit);
            let job = service.submit(Arc::clone(&ledger), tracers, SMALL).unwrap();
            std::thread::sleep(Duration::from_micros(random / 64 % 300));
            match random / 1024 % 6 {
                0 => drop(job),
                1 => {
                    job.cancel();
                    assert!(!matches!(outcome(job), Err(JobError::Panicked { .. })) || panic_at.is_some());
                }
                2 => {
                    job.stop();
                    match outcome(job) {
                        Ok(_) => {
                            ledger.check_complete();
                        }
                        Err(error) => assert!(panic_at.is_some(), "{error}"),
                    }
                }
                _ => match outcome(job) {
                    Ok(report) => {
                        assert!(!report.stopped);
                        ledger.check_complete();
                        kept += 1;
                    }
                    Err(error) => assert!(panic_at.is_some(), "{error}"),
                },
            }
        }
        kept
    };
    let kept: u32 = std::thread::scope(|scope| {
        let owners: Vec<_> = (0..4).map(|owner| scope.spawn(move || run(owner))).collect();
        owners.into_iter().map(|owner| owner.join().unwrap()).sum()
    });
    assert!(kept > 40);
}
