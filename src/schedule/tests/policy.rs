//! The rules, one by one.

use super::super::policy::{
    Pace, SMALL_TASK_NS, TURN_RAYS, choose, choose_dispatch, chunk_rays, most_rays, threshold,
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
    shade: 0,
    tasks: 0,
    cpu: UNKNOWN,
    gpu: UNKNOWN,
};
const UNKNOWN: Pace = Pace { rays: 0, ns: 0 };
const ALL: View = View { tiles_left: 1, need_more: 1, trace: 1, slot: true, shade: 1, ..IDLE };
const BUSY: Load = Load { hosts: 2, dispatchers: 4, idle_dispatchers: 0 };
const IDLE_DEVICE: Load = Load { idle_dispatchers: 1, ..BUSY };

fn turn(view: View, served: u64) -> Turn {
    Turn { view, priority: Priority::Normal, served }
}

/// A host thread's task.
fn rule(view: View, load: Load) -> Option<Rule> {
    choose(&[turn(view, 0)], load, Sharing::Fair).map(|choice| choice.rule)
}

/// A dispatch thread's task.
fn dispatch_rule(view: View, load: Load) -> Option<Rule> {
    choose_dispatch(&[turn(view, 0)], load, Sharing::Fair).map(|choice| choice.rule)
}

/// True if a dispatch thread has a task.
fn dispatched(view: View, load: Load) -> bool {
    dispatch_rule(view, load).is_some()
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
    let dispatch = |view| dispatched(view, IDLE_DEVICE);
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
    assert_eq!(choose_dispatch(&turns, BUSY, Sharing::Fair).map(|c| c.job), Some(1));
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
    let full = |left| threshold(left, 2, false, &limits);
    assert_eq!((full(u64::MAX), full(0)), (limits.threshold, limits.chunk_rays));
    assert_eq!(full(8 * 3000 - 1), 3000);
    assert_eq!(threshold(0, 2, true, &limits), limits.threshold);
    // Streams that were full earlier still are, so few can be full: about as many as L makes at this threshold.
    for left in (1..300_000).step_by(37) {
        assert!(full(left) <= full(left + 37));
        assert!(left / full(left) as u64 <= (limits.in_flight / limits.threshold).max(8) as u64 + 4);
    }
}

#[test]
fn chunks_are_large_until_the_tail() {
    let limits = Limits::for_tests();
    let chunk = |waiting| chunk_rays(waiting, 4, false, &limits);
    assert_eq!(chunk(u64::MAX), limits.chunk_rays_most);
    assert_eq!(chunk(0), limits.chunk_rays);
    assert_eq!(chunk(8 * 3 * limits.chunk_rays as u64 - 1), 3 * limits.chunk_rays);
    assert_eq!(chunk_rays(u64::MAX, 4, true, &limits), limits.chunk_rays);
    let sizes: Vec<_> = (0..100_000).step_by(997).map(chunk).collect();
    assert!(sizes.is_sorted() && sizes.iter().all(|size| size % limits.chunk_rays == 0));
}

#[test]
fn moonray_keeps_on_the_cpu_what_is_small_or_would_wait() {
    let full = View { policy: Policy::MoonRay, trace: 1, trace_rays: 20_000, ..IDLE };
    let load = |dispatchers, idle_dispatchers| Load { hosts: 2, dispatchers, idle_dispatchers };
    // One dispatch thread is served, and up to three wait.
    for (dispatchers, idle, device) in
        [(4, 4, true), (4, 1, true), (4, 0, false), (8, 5, true), (8, 4, false)]
    {
        let load = load(dispatchers, idle);
        assert_eq!(dispatched(full, load), device, "{load:?}");
        assert_eq!(rule(full, load), (!device).then_some(Rule::Trace), "{load:?}");
    }
    let small = View { need_more: 1, need_more_rays: 1024, trace: 0, ..full };
    assert!(!dispatched(small, IDLE_DEVICE) && rule(small, IDLE_DEVICE) == Some(Rule::Flush));
    let larger = View { need_more_rays: 1025, ..small };
    assert!(dispatched(larger, IDLE_DEVICE) && rule(larger, IDLE_DEVICE).is_none());
    assert!(!dispatched(View { tiles_left: 1, ..larger }, IDLE_DEVICE), "a tile may still fill it");
    assert_eq!(rule(larger, BUSY), Some(Rule::Flush));
    assert_eq!(rule(View { unit: Unit::Cpu, ..larger }, IDLE_DEVICE), Some(Rule::Flush));
}

#[test]
fn measured_rates_let_both_units_end_together() {
    // A host thread traces a ray in 100 ns.
    let cpu = Pace { rays: 1000, ns: 100_000 };
    let view = |gpu_ns: u64, trace: usize, waiting_rays| View {
        policy: Policy::MeasuredRate,
        trace,
        trace_rays: 10_000 * trace,
        waiting_rays,
        cpu,
        gpu: Pace { rays: 1000, ns: 1000 * gpu_ns },
        ..IDLE
    };
    // Two host threads need 0.5 ms for a stream, this device 10 ms: only while there is much to do.
    assert!(dispatched(view(1000, 2, 1_000_000), IDLE_DEVICE));
    let tail = view(1000, 2, 20_000);
    assert!(!dispatched(tail, IDLE_DEVICE) && rule(tail, IDLE_DEVICE) == Some(Rule::Trace));
    assert_eq!(rule(tail, BUSY), Some(Rule::Trace));
    // A fast device, 0.1 ms a stream, has traced its streams before host threads have traced one.
    let fast = view(10, 2, 20_000);
    assert!(dispatched(fast, IDLE_DEVICE) && rule(fast, BUSY).is_none());
    // Not if it has a great many.
    assert_eq!(rule(view(10, 40, 400_000), BUSY), Some(Rule::Trace));
    // Units that have not been measured are tried.
    let unknown = View { cpu: Pace::default(), ..tail };
    assert!(dispatched(unknown, IDLE_DEVICE) && rule(unknown, BUSY) == Some(Rule::Trace));
}

#[test]
fn under_every_policy_some_thread_takes_a_full_stream() {
    for policy in Policy::ALL {
        for case in 0..10_000u64 {
            let random = |salt: u64| super::ledger::mix(case << 8 | salt);
            let dispatchers = 1 + random(0) as usize % 6;
            let load = Load {
                hosts: 1 + random(1) as usize % 8,
                dispatchers,
                idle_dispatchers: random(2) as usize % (dispatchers + 1),
            };
            let view = View {
                policy,
                need_more: random(3) as usize % 2,
                need_more_rays: random(4) as usize % 4096,
                trace: random(5) as usize % 2,
                trace_rays: random(6) as usize % 50_000,
                waiting_rays: random(7) % 500_000,
                cpu: Pace { rays: random(8) % 1000, ns: random(9) % 1_000_000 },
                gpu: Pace { rays: random(10) % 1000, ns: random(11) % 1_000_000 },
                ..IDLE
            };
            if view.trace + view.need_more > 0 {
                let device = dispatched(view, load);
                let idle = device && load.idle_dispatchers > 0;
                // A busy device comes back; host threads have to wait for it only if it may take the stream.
                let busy = device && load.idle_dispatchers == 0 && view.trace > 0;
                assert!(idle || busy || rule(view, load).is_some(), "{view:?} {load:?}");
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
    // Dispatch threads too.
    let full = View { trace: 1, ..IDLE };
    let choice = choose_dispatch(&[at(low, full), at(normal, full)], IDLE_DEVICE, Sharing::FirstIn);
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
