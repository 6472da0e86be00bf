//! The rules, one by one.

use super::super::policy::{
    DevicePace, Line, Pace, PathLengths, QUEUED, SMALL_TASK_NS, TURN_RAYS, choose, choose_bundle, chunk_rays,
    most_rays, threshold,
};
use super::super::{Limits, Load, Policy, Priority, Rule, Sharing, TaskSize, Turn, Unit, View};

const IDLE: View = View {
    unit: Unit::Hybrid,
    policy: Policy::RayAccelerator,
    ended: false,
    tiles_left: 0,
    tile_fits: true,
    need_more: 0,
    need_more_rays: 0,
    trace: 0,
    trace_rays: 0,
    waiting_rays: 0,
    slot: false,
    answered: 0,
    shade: 0,
    tasks: 0,
    cpu: UNKNOWN,
    shading: UNKNOWN,
    device: DevicePace {
        bundles: 0,
        submit_ns: 0,
        resolving: UNKNOWN,
        turnaround: Line { ns_for_1024: 0, latency_ns: 0 },
    },
    bundle_rays: 50_000,
    on_device: 0,
    on_device_rays: 0,
    with_device: 0,
    failed: 0,
    paths_left: 0,
    lengths: PathLengths { shaded: 0, continued: 0, rays: 0, shadow_rays: 0 },
};
const UNKNOWN: Pace = Pace { rays: 0, ns: 0 };
const ALL: View = View { tiles_left: 1, need_more: 1, trace: 1, slot: true, shade: 1, ..IDLE };
const BUSY: Load = Load { hosts: 2, queued: QUEUED };
const IDLE_DEVICE: Load = Load { queued: 0, ..BUSY };

fn turn(view: View, served: u64) -> Turn {
    Turn { view, priority: Priority::Normal, served }
}

/// A host thread's task.
fn rule(view: View, load: Load) -> Option<Rule> {
    choose(&[turn(view, 0)], load, Sharing::Fair).map(|choice| choice.rule)
}

/// True if the device is given a bundle.
fn submitted(view: View, load: Load) -> bool {
    let choice = choose_bundle(&[turn(view, 0)], load, Sharing::Fair);
    choice.is_some_and(|choice| choice.rule == Rule::Submit)
}

#[test]
fn rules_come_in_the_order_of_the_paper() {
    assert_eq!(rule(ALL, BUSY), Some(Rule::Spawn));
    assert_eq!(rule(View { tile_fits: false, ..ALL }, BUSY), Some(Rule::Shade));
    let traced = View { tiles_left: 0, shade: 0, ..ALL };
    assert_eq!(rule(traced, BUSY), Some(Rule::Trace));
    let small = View { slot: false, trace: 0, ..traced };
    assert_eq!(rule(small, BUSY), Some(Rule::Flush));
    assert_eq!(rule(IDLE, BUSY), None);
    assert_eq!(rule(View { ended: true, ..ALL }, BUSY), None);
}

#[test]
fn host_threads_leave_full_streams_to_an_idle_device() {
    let full = View { trace: 1, ..IDLE };
    assert_eq!(rule(full, IDLE_DEVICE), None);
    assert_eq!(rule(full, BUSY), Some(Rule::Trace));
    // Other host threads help to finish a stream that one has opened.
    assert_eq!(rule(View { slot: true, ..IDLE }, IDLE_DEVICE), Some(Rule::Trace));
    assert_eq!(rule(View { need_more: 1, ..full }, IDLE_DEVICE), Some(Rule::Flush));
}

#[test]
fn the_device_alone_traces_unless_lost() {
    let view = View { unit: Unit::Gpu, trace: 1, need_more: 1, ..IDLE };
    assert_eq!(rule(view, BUSY), None);
    assert_eq!(rule(View { unit: Unit::Cpu, ..view }, BUSY), Some(Rule::Trace));
    let dispatch = |view| submitted(view, IDLE_DEVICE);
    let small = View { trace: 0, ..view };
    assert!(dispatch(view) && dispatch(small));
    assert!(!dispatch(View { tiles_left: 1, ..small }) && !dispatch(View { shade: 1, ..small }));
    assert!(!dispatch(View { unit: Unit::Hybrid, ..small }), "a host thread flushes it");
    assert!(!dispatch(View { unit: Unit::Cpu, ..view }));
}

#[test]
fn small_streams_are_flushed_only_when_nothing_else_is_there() {
    // The README's bound on small streams rests on this, whatever the order of rules.
    for unit in [Unit::Cpu, Unit::Hybrid] {
        let small = View { unit, need_more: 1, ..IDLE };
        assert!(small.allows(Rule::Flush, BUSY));
        assert!(!View { shade: 1, ..small }.allows(Rule::Flush, BUSY));
        assert!(!View { slot: true, ..small }.allows(Rule::Flush, BUSY));
        let full = View { trace: 1, ..small };
        assert_eq!(full.allows(Rule::Flush, BUSY), unit == Unit::Hybrid);
    }
}

#[test]
fn without_a_device_shading_follows_tracing() {
    let view = View { unit: Unit::Cpu, policy: Policy::of(Unit::Cpu), ..ALL };
    assert_eq!(rule(view, BUSY), Some(Rule::Shade));
    assert_eq!(rule(View { shade: 0, ..view }, BUSY), Some(Rule::Trace));
    assert_eq!(rule(View { shade: 0, slot: false, trace: 0, ..view }, BUSY), Some(Rule::Spawn));
}

#[test]
fn the_job_served_least_is_next() {
    let turns = [turn(ALL, 5 * TURN_RAYS), turn(ALL, 4 * TURN_RAYS - 1), turn(ALL, 3 * TURN_RAYS)];
    assert_eq!(choose(&turns, BUSY, Sharing::Fair).map(|c| c.job), Some(1));
    assert_eq!(choose(&turns, BUSY, Sharing::FirstIn).map(|c| c.job), Some(0));
    assert_eq!(choose_bundle(&turns, IDLE_DEVICE, Sharing::Fair).map(|c| c.job), Some(1));
}

#[test]
fn a_small_stream_waits_only_while_it_may_grow() {
    let small = View { need_more: 1, ..IDLE };
    let first = |tasks| {
        let choice =
            choose(&[turn(View { tasks, ..small }, 0), turn(ALL, 9 * TURN_RAYS)], BUSY, Sharing::Fair);
        choice.map(|choice| choice.job)
    };
    assert_eq!(first(1), Some(1));
    assert_eq!(first(0), Some(0));
    assert_eq!(rule(View { tasks: 1, ..small }, BUSY), Some(Rule::Flush));
}

#[test]
fn streams_are_large_until_the_tail() {
    let limits = Limits::for_tests();
    let full = |left| threshold(left, 2, &limits);
    assert_eq!((full(u64::MAX), full(0)), (limits.threshold, limits.chunk_rays));
    assert_eq!(full(8 * 3000 - 1), 3000);
    let whole = Limits { shrink_streams: false, ..limits };
    assert_eq!(threshold(0, 2, &whole), limits.threshold);
    // Streams that were full earlier still are, so few can be full: about as many as L makes at this threshold.
    for left in (1..300_000).step_by(37) {
        assert!(full(left) <= full(left + 37));
        assert!(left / full(left) as u64 <= (limits.in_flight / limits.threshold).max(8) as u64 + 4);
    }
}

#[test]
fn chunks_are_large_until_the_tail() {
    let limits = Limits::for_tests();
    let chunk = |waiting| chunk_rays(waiting, 4, &limits);
    assert_eq!(chunk(u64::MAX), limits.chunk_rays_most);
    assert_eq!(chunk(0), limits.chunk_rays);
    assert_eq!(chunk(8 * 3 * limits.chunk_rays as u64 - 1), 3 * limits.chunk_rays);
    let sizes: Vec<_> = (0..100_000).step_by(997).map(chunk).collect();
    assert!(sizes.is_sorted() && sizes.iter().all(|size| size % limits.chunk_rays == 0));
}

#[test]
fn a_bundle_is_submitted_when_it_is_full_or_the_device_has_none() {
    let full = |trace_rays| View { trace: 3, trace_rays, on_device: 1, shade: 1, ..IDLE };
    let load = |queued| Load { hosts: 2, queued };
    for (trace_rays, queued, is_submitted) in
        [(100, 0, true), (49_999, 1, false), (50_000, 1, true), (1 << 20, 2, false)]
    {
        assert_eq!(submitted(full(trace_rays), load(queued)), is_submitted, "{trace_rays} {queued}");
    }
    // What will not be full is not waited for.
    assert!(submitted(View { shade: 0, ..full(100) }, load(1)));
    // Answers come before all else.
    assert_eq!(rule(View { answered: 1, ..ALL }, BUSY), Some(Rule::Resolve));
}

#[test]
fn host_threads_take_streams_from_a_device_that_would_be_later() {
    let known = DevicePace {
        resolving: Pace { rays: 1024, ns: 1024 },
        turnaround: Line { ns_for_1024: 1000, latency_ns: 0 },
        ..IDLE.device
    };
    let waiting = View { on_device: 2, with_device: 4, on_device_rays: 4096, ..IDLE };
    let paced = |ns| View { cpu: Pace { rays: 1024, ns }, device: known, ..waiting };
    // Two threads trace a stream of 1024 rays in half the time of one, the device 4096 in 4000 ns.
    assert_eq!(rule(paced(4000), BUSY), Some(Rule::Reclaim));
    assert_eq!(rule(paced(4100), BUSY), None);
    // How late a device is that has not answered is not known.
    assert_eq!(rule(waiting, BUSY), Some(Rule::Reclaim));
    assert_eq!(rule(View { with_device: 0, ..waiting }, BUSY), None);
    assert_eq!(rule(View { unit: Unit::Gpu, ..waiting }, BUSY), None);
    // Other work comes first, and with it that of other jobs.
    for (busy, first) in [
        (View { tiles_left: 1, ..waiting }, Rule::Spawn),
        (View { shade: 1, ..waiting }, Rule::Shade),
        (View { slot: true, ..waiting }, Rule::Trace),
        (View { need_more: 1, ..waiting }, Rule::Flush),
        (View { answered: 1, ..waiting }, Rule::Resolve),
    ] {
        assert_eq!(rule(busy, BUSY), Some(first));
        let turns = [turn(View { tasks: 2, ..waiting }, 0), turn(busy, TURN_RAYS)];
        assert_eq!(choose(&turns, BUSY, Sharing::Fair).map(|c| c.rule), Some(first));
    }
    // Whatever a lost device has goes back before anything else.
    let failed = View { unit: Unit::Cpu, failed: 1, with_device: 1, ..ALL };
    assert_eq!(rule(failed, BUSY), Some(Rule::Reclaim));
}

#[test]
fn moonray_keeps_on_the_cpu_what_is_small_or_would_wait() {
    let full = View { policy: Policy::MoonRay, trace: 1, trace_rays: 20_000, shade: 0, ..IDLE };
    for (queued, device) in [(0, true), (1, true), (2, false)] {
        let load = Load { hosts: 2, queued };
        assert_eq!(submitted(full, load), device, "{load:?}");
        assert_eq!(rule(full, load), (!device).then_some(Rule::Trace), "{load:?}");
    }
    let small = View { need_more: 1, need_more_rays: 1024, trace: 0, ..full };
    assert!(!submitted(small, IDLE_DEVICE) && rule(small, IDLE_DEVICE) == Some(Rule::Flush));
    let larger = View { need_more_rays: 1025, ..small };
    assert!(submitted(larger, IDLE_DEVICE) && rule(larger, IDLE_DEVICE).is_none());
    assert!(!submitted(View { tiles_left: 1, ..larger }, IDLE_DEVICE), "a tile may still fill it");
    assert_eq!(rule(larger, BUSY), Some(Rule::Flush));
    assert_eq!(rule(View { unit: Unit::Cpu, ..larger }, IDLE_DEVICE), Some(Rule::Flush));
}

/// A job of a path tracer on two host threads that take 100 ns to trace a ray and 80 ns to shade one, beside a device
/// that takes 10 ns and has a latency of a tenth of a millisecond.
const MEASURED: View = View {
    policy: Policy::MeasuredRate,
    trace: 4,
    trace_rays: 40_000,
    cpu: Pace { rays: 1000, ns: 100_000 },
    shading: Pace { rays: 1000, ns: 80_000 },
    device: DevicePace {
        bundles: 9,
        submit_ns: 50_000,
        resolving: Pace { rays: 1000, ns: 3000 },
        turnaround: Line { ns_for_1024: 10_240, latency_ns: 100_000 },
    },
    paths_left: 1_000_000,
    lengths: PathLengths { shaded: 5000, continued: 4000, rays: 5000, shadow_rays: 4000 },
    ..IDLE
};

#[test]
fn a_device_is_fed_while_its_rays_cost_less_than_the_hosts_own() {
    assert!(submitted(MEASURED, IDLE_DEVICE) && rule(MEASURED, IDLE_DEVICE).is_none());
    let with = |resolve_ns, submit_ns| {
        let resolving = Pace { rays: 1, ns: resolve_ns };
        View { device: DevicePace { resolving, submit_ns, ..MEASURED.device }, ..MEASURED }
    };
    for expensive in [with(101, 0), with(3, 4_000_000)] {
        assert!(!submitted(expensive, IDLE_DEVICE), "no device is an answer");
        assert_eq!(rule(expensive, IDLE_DEVICE), Some(Rule::Trace));
    }
    // A full queue is helped, if a stream takes less time than the bundle that comes back first.
    let full = View { trace_rays: 80_000, trace: 8, on_device: 2, on_device_rays: 400_000, ..MEASURED };
    assert_eq!(rule(full, BUSY), Some(Rule::Trace));
    assert_eq!(rule(View { on_device_rays: 4000, ..full }, BUSY), None);
    // While the next bundle is not full, tiles come first.
    assert_eq!(rule(View { tiles_left: 9, shade: 3, ..MEASURED }, BUSY), Some(Rule::Spawn));
}

#[test]
fn at_the_tail_a_device_is_fed_only_if_no_thread_has_to_wait_for_it() {
    // These are the last rays: two threads trace them in 2 ms, the device answers after 0.5 ms.
    let last = View { paths_left: 22_000, ..MEASURED };
    assert!(submitted(last, IDLE_DEVICE));
    let slow = |latency_ns| {
        let turnaround = Line { latency_ns, ..last.device.turnaround };
        View { device: DevicePace { turnaround, ..last.device }, ..last }
    };
    assert!(!submitted(slow(5_000_000), IDLE_DEVICE), "both threads would wait");
    assert!(
        submitted(View { paths_left: 1_000_000, ..slow(5_000_000) }, IDLE_DEVICE),
        "they have other work"
    );
    assert!(!submitted(View { on_device: 1, on_device_rays: 400_000, ..last }, IDLE_DEVICE));
}

#[test]
fn a_device_is_tried_with_one_bundle_once_host_threads_have_traced() {
    let fresh = View { device: DevicePace::default(), cpu: Pace::default(), need_more: 1, ..MEASURED };
    assert!(!submitted(fresh, IDLE_DEVICE) && rule(fresh, IDLE_DEVICE) == Some(Rule::Flush));
    let traced = View { cpu: MEASURED.cpu, need_more: 0, ..fresh };
    assert!(submitted(traced, IDLE_DEVICE));
    let tried = View { device: DevicePace { bundles: 1, ..DevicePace::default() }, on_device: 1, ..traced };
    assert!(!submitted(tried, IDLE_DEVICE) && rule(tried, IDLE_DEVICE) == Some(Rule::Trace));
}

#[test]
fn under_every_policy_some_thread_takes_a_full_stream() {
    for policy in Policy::ALL {
        for case in 0..30_000u64 {
            let random = |salt: u64| super::ledger::mix(case << 8 | salt);
            let pace = |salt| Pace { rays: random(salt) % 1000, ns: random(salt + 1) % 1_000_000 };
            let on_device = random(1) as usize % (QUEUED + 1);
            let load = Load { hosts: 1 + random(2) as usize % 8, queued: on_device };
            let shaded = random(20) % 1_000_000;
            let view = View {
                policy,
                need_more: random(3) as usize % 2,
                need_more_rays: random(4) as usize % 4096,
                trace: random(5) as usize % 2,
                trace_rays: random(6) as usize % 100_000,
                waiting_rays: random(7) % 500_000,
                cpu: pace(8),
                shading: pace(10),
                device: DevicePace {
                    bundles: random(12) % 3,
                    submit_ns: random(13) % 1_000_000,
                    resolving: pace(14),
                    turnaround: Line {
                        ns_for_1024: random(16) % 1_000_000,
                        latency_ns: random(17) % 10_000_000,
                    },
                },
                on_device,
                on_device_rays: if on_device == 0 { 0 } else { random(18) % 500_000 },
                paths_left: random(19) % 1_000_000,
                lengths: PathLengths {
                    shaded,
                    continued: random(21) % (shaded + 1),
                    rays: random(22) % 1_000_000,
                    shadow_rays: random(23) % 1_000_000,
                },
                ..IDLE
            };
            if view.trace + view.need_more > 0 {
                // A device that has a bundle comes back.
                let comes_back = on_device > 0;
                let takes = submitted(view, load) || rule(view, load).is_some();
                assert!(takes || comes_back, "{view:?} {load:?}");
            }
        }
    }
}

#[test]
fn a_lower_priority_gets_what_the_higher_ones_leave() {
    let at = |priority, view| Turn { priority, ..turn(view, 0) };
    let job = |turns: &[Turn]| choose(turns, BUSY, Sharing::Fair).map(|choice| (choice.job, choice.rule));
    let (low, normal, high) = (Priority::Background, Priority::Normal, Priority::Interactive);
    assert_eq!(job(&[at(low, ALL), at(normal, ALL), at(high, ALL)]), Some((2, Rule::Spawn)));
    // Even the last resort of a job comes before the first choice of one with a lower priority.
    let last = View { need_more: 1, tasks: 1, ..IDLE };
    assert_eq!(job(&[at(normal, ALL), at(high, last)]), Some((1, Rule::Flush)));
    assert_eq!(job(&[at(low, ALL), at(normal, last)]), Some((1, Rule::Flush)));
    assert_eq!(
        job(&[at(low, ALL), at(normal, IDLE), at(high, View { ended: true, ..ALL })]),
        Some((0, Rule::Spawn))
    );
    // The device thread too.
    let full = View { trace: 1, ..IDLE };
    let choice = choose_bundle(&[at(low, full), at(normal, full)], IDLE_DEVICE, Sharing::FirstIn);
    assert_eq!(choice.map(|choice| choice.job), Some(1));
}

#[test]
fn small_tasks_take_half_a_millisecond_at_the_pace_of_the_job() {
    let limits = Limits::for_tests();
    let pace = |ns_per_ray: u64| Pace { rays: 1000, ns: 1000 * ns_per_ray };
    assert_eq!(SMALL_TASK_NS, 500_000);
    assert_eq!(most_rays(TaskSize::Small, pace(100), &limits), 5000);
    assert_eq!(most_rays(TaskSize::Large, pace(100), &limits), usize::MAX);
    // Chunks of fewer than 1024 rays would trace more slowly.
    assert_eq!(most_rays(TaskSize::Small, pace(10_000), &limits), 1024);
    assert_eq!(most_rays(TaskSize::Small, Pace::default(), &limits), 1024);
}
