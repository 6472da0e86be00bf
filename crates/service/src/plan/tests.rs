//! What predictions must fulfil.

use super::*;
use raystream::schedule::Priority;

/// Ten gigabits a second.
fn farm(machines: u32) -> Farm {
    Farm { machines, network_bits: 1e10, failure_s: None, compared: 0.0 }
}

/// Costs in which nothing but samples takes time, with a slot a machine.
fn free() -> Costs {
    Costs {
        slots: 1,
        unit_s: 0.0,
        startup_s: 0.0,
        scene_bytes: 0.0,
        read_s: 0.0,
        round_trip_s: 0.0,
        question_s: 0.0,
        keep_s: 0.0,
        keep_byte_s: 0.0,
        commit_s: 0.0,
        look_s: 0.0,
        offer_s: 0.0,
        plan_s: 0.0,
        open_s: 0.0,
        finish_s: 0.0,
        ..Costs::default()
    }
}

fn job(frames: u32, spp: u32) -> FramesJob {
    let (name, size, priority) = ("test".into(), (640, 480), Priority::Normal);
    FramesJob { name, size, spp, frames, priority }
}

fn of(job: FramesJob) -> PlannedJob {
    PlannedJob::Frames(job)
}

#[test]
fn one_machine_takes_the_sum() {
    // With one slot nothing happens at the same time, so the job takes what its parts take together.
    let costs = Costs {
        unit_s: 0.01,
        startup_s: 2.0,
        scene_bytes: 1e6,
        read_s: 3.0,
        round_trip_s: 0.002,
        question_s: 0.001,
        keep_s: 0.004,
        commit_s: 0.003,
        finish_s: 5.0,
        ..free()
    };
    let farm = farm(1);
    let found = predict(&farm, &costs, &of(job(1, 256)));
    let units = found.units as f64;
    let samples = 640.0 * 480.0 * 256.0 / costs.samples_per_second;
    let per_byte = 8.0 / farm.network_bits;
    let scene = costs.scene_bytes * per_byte + 2.0 * (costs.question_s + costs.round_trip_s) + costs.read_s;
    // Two trips to a unit, one question with its answer, one result with its answer, one end of the lease; and the
    // time in which the coordinator answers.
    let each =
        5.0 * costs.round_trip_s + 2.0 * costs.question_s + costs.keep_s + costs.commit_s + costs.unit_s;
    let sum = costs.startup_s + scene + samples + units * each + found.bytes * per_byte + costs.finish_s;
    let slack = 0.3 + 3.0 * each;
    assert!((found.seconds - sum).abs() < slack, "{} s, not {sum} s", found.seconds);
    assert!(units > 50.0 && sum > 80.0, "{units} units, {sum} s");
    let idle = 1.0 - (samples + units * costs.unit_s + costs.read_s) / found.seconds;
    assert!((found.idle_share - idle).abs() < 1e-6, "{} of {idle}", found.idle_share);
}

#[test]
fn without_other_costs_machines_divide_the_time() {
    let one = predict(&farm(1), &free(), &of(job(1, 1024))).seconds;
    for machines in [2, 3, 8, 40] {
        let found = predict(&farm(machines), &free(), &of(job(1, 1024)));
        let ideal = one / f64::from(machines);
        // No machine has more than a unit while another has none. The planner looks every quarter of a second.
        let unit = 2.5;
        assert!(found.seconds >= ideal - 1e-6, "{machines}: {} s, {ideal} s", found.seconds);
        assert!(found.seconds < ideal + unit, "{machines}: {} s, {ideal} s", found.seconds);
    }
}

#[test]
fn more_machines_are_not_slower_by_more_than_a_unit() {
    let costs = Costs { finish_s: 0.1, ..Costs::default() };
    let mut before = f64::INFINITY;
    for machines in [1, 2, 3, 5, 8, 13, 21, 34, 55, 89, 144] {
        let found = predict(&farm(machines), &costs, &of(job(2, 512)));
        assert!(found.seconds < before + 2.0, "{machines} machines: {} s, before {before} s", found.seconds);
        before = before.min(found.seconds);
    }
    assert!(before < 20.0, "{before} s");
}

#[test]
fn predictions_are_the_same_each_time() {
    let farm = Farm { failure_s: Some(100.0), compared: 0.2, ..farm(7) };
    let found = || predict(&farm, &Costs::default(), &of(job(3, 200)));
    let first = found();
    assert_eq!(first, found());
    assert!(first.failed.is_none(), "{first:?}");
    let live = || predict(&farm, &Costs::default(), &PlannedJob::live());
    assert_eq!(live(), live());
}

#[test]
fn all_samples_are_taken_whatever_fails() {
    let job = of(job(2, 400));
    let whole = predict(&farm(5), &Costs::default(), &job);
    let failing = Farm { failure_s: Some(40.0), ..farm(5) };
    let found = predict(&failing, &Costs::default(), &job);
    assert!(found.failed.is_none() && found.redeliveries > 3, "{found:?}");
    // What is lost is rendered again.
    assert!(found.seconds > whole.seconds + 1.0, "{} s, {} s", found.seconds, whole.seconds);
    assert_eq!(whole.redeliveries, 0);
    // Machines that always fail before a unit ends do nothing, and the job is given up.
    let hopeless = Farm { failure_s: Some(0.01), ..farm(5) };
    let found = predict(&hopeless, &Costs { startup_s: 0.1, ..Costs::default() }, &job);
    assert!(found.failed.is_some(), "{found:?}");
}

#[test]
fn compared_units_are_rendered_twice() {
    let job = of(job(1, 600));
    let once = predict(&farm(4), &free(), &job);
    let twice = predict(&Farm { compared: 1.0, ..farm(4) }, &free(), &job);
    let ratio = twice.seconds / once.seconds;
    assert!((1.8..2.3).contains(&ratio), "{ratio}");
    let alone = predict(&Farm { compared: 1.0, ..farm(1) }, &free(), &job);
    assert_eq!(alone.seconds, predict(&farm(1), &free(), &job).seconds, "there is no one to compare with");
}

#[test]
fn jobs_share_a_farm() {
    let costs = free();
    let (first, second) = (job(1, 600), job(1, 600));
    let alone = predict(&farm(4), &costs, &of(first.clone())).seconds;
    let both = predict_together(&farm(4), &costs, &[first.clone(), second]);
    assert!((both.seconds / alone - 2.0).abs() < 0.2, "{} s, {alone} s alone", both.seconds);
    // An urgent one ends nearly as if it were alone, so the last to end is the other.
    let urgent = FramesJob { priority: Priority::Interactive, ..job(1, 300) };
    let mixed = predict_together(&farm(4), &costs, &[first, urgent]);
    assert!((mixed.seconds / alone - 1.5).abs() < 0.2, "{} s, {alone} s alone", mixed.seconds);
    assert_eq!(mixed.job, "test+test");
}

#[test]
fn a_slow_network_is_the_limit() {
    let slow = Farm { network_bits: 1e7, ..farm(64) };
    let found = predict(&slow, &Costs { scene_bytes: 0.0, ..Costs::default() }, &of(job(1, 4096)));
    let busiest = found.busiest().expect("parts");
    assert_eq!(busiest.name, "link to the coordinator", "{found:?}");
    assert!(busiest.share > 0.9 && busiest.share <= 1.0 + 1e-9 && found.idle_share > 0.3, "{found:?}");
    let least = found.bytes * 8.0 / slow.network_bits;
    assert!(found.seconds > least, "{} s for what takes {least} s", found.seconds);
}

#[test]
fn ten_thousand_machines_render_a_still() {
    let still = FramesJob { size: (1920, 1080), ..job(1, 512) };
    let found = predict(&farm(10_000), &Costs::default(), &of(still));
    assert!(found.failed.is_none() && found.units > 1000, "{found:?}");
}

/// A live view of whole strips.
fn view(size: (u32, u32)) -> PlannedJob {
    PlannedJob::Live(LiveJob { name: "view".into(), size, spp: 1, frames: 100, pixel_bytes: 0.0 })
}

#[test]
fn moving_frames_take_the_time_that_a_view_aims_at() {
    // 4 machines and the coordinator render 5 million pixels a second together. A view aims at frames of 55 ms, and
    // takes those of 46 to 66 ms for that; whole frames would take 184 ms.
    let found = predict(&farm(4), &free(), &view((1280, 720)));
    assert!((15.0..22.0).contains(&found.frames_per_second), "{found:?}");
    let pixels_per_second = 100.0 * 1280.0 * 720.0 / found.seconds;
    // Rows are given in strips of 16, so that not all end at the same time.
    assert!((0.8..1.0).contains(&(pixels_per_second / 5e6)), "{pixels_per_second}");
    assert!((found.power, found.redeliveries) == (5.0, 0), "{found:?}");
    // On a coordinator that is four times as fast they are sharper.
    let fast = Costs { coordinator_samples_per_second: 4e6, ..free() };
    let faster = predict(&farm(4), &fast, &view((1280, 720)));
    assert!(
        (1.3..1.7).contains(&(found.seconds / faster.seconds)),
        "{} s, {} s",
        found.seconds,
        faster.seconds
    );
}

#[test]
fn a_view_waits_for_one_frame_before_it_begins_the_next() {
    let idle =
        |round_trip_s| predict(&farm(4), &Costs { round_trip_s, ..free() }, &view((640, 400))).idle_share;
    // While a tile travels, its machine has nothing to do.
    let (near, far) = (idle(0.0), idle(0.02));
    assert!(near < 0.15 && far > near + 0.25, "{near}, {far}");
}

#[test]
fn machines_that_are_too_slow_are_late_and_stop_no_view() {
    // A tile's answer takes 90 ms on its way, and a frame is whole after 80.
    let slow = Costs { round_trip_s: 0.09, ..free() };
    let found = predict(&farm(3), &slow, &view((640, 400)));
    assert!(found.redeliveries > 0 && found.frames_per_second > 8.0, "{found:?}");
    // All of them miss three frames and then rest for five seconds, in which the coordinator renders alone.
    let alone = predict(&farm(1), &slow, &view((640, 400)));
    assert!(
        (0.8..1.2).contains(&(found.seconds / alone.seconds)),
        "{} s, {} s",
        found.seconds,
        alone.seconds
    );
}

#[test]
fn a_live_view_is_faster_with_more_machines_until_strips_are_few() {
    let seconds = |machines: u32| predict(&farm(machines), &Costs::default(), &PlannedJob::live()).seconds;
    let some = [1, 2, 5, 10, 20, 30].map(seconds);
    assert!(some.is_sorted_by(|fewer, more| fewer > more), "{some:?}");
    let (all, more) = (seconds(44), seconds(2000));
    assert!(some[0] > 5.0 * some[3] && some[3] > 2.0 * all, "{some:?}, {all}");
    // 720 rows are 45 strips: one for the coordinator, one for each of 44 machines.
    assert!((0.99..1.01).contains(&(all / more)), "{all}, {more}");
}

#[test]
fn costs_that_make_no_sense_are_named() {
    assert_eq!(Costs::default().problem(), None);
    let wrong = [
        (Costs { slots: 0, ..free() }, "slots"),
        (Costs { samples_per_second: 0.0, ..free() }, "samples_per_second"),
        (Costs { read_s: -1.0, ..free() }, "read_s"),
        (Costs { keep_s: f64::NAN, ..free() }, "keep_s"),
    ];
    for (costs, name) in wrong {
        assert!(costs.problem().is_some_and(|problem| problem.starts_with(name)), "{name}");
    }
}

#[test]
fn the_frames_between_are_as_if_they_were_simulated() {
    for machines in [1, 7, 60] {
        let job = FramesJob { frames: 700, ..job(1, 16) };
        let found = predict(&farm(machines), &Costs::default(), &of(job.clone()));
        let all = simulator::Simulator::new(&farm(machines), &Costs::default(), &[job], 0).run();
        let near = |one: f64, other: f64| (one - other).abs() <= 0.03 * other.abs() + 1e-3;
        assert!(near(found.seconds, all.seconds), "{machines}: {} s, not {} s", found.seconds, all.seconds);
        assert!(
            near(found.units as f64, all.units as f64) && near(found.bytes, all.bytes),
            "{found:?} {all:?}"
        );
        assert!(
            near(found.idle_share, all.idle_share) && near(found.unit_s, all.unit_s),
            "{found:?} {all:?}"
        );
        for (found, all) in found.loads.iter().zip(&all.loads) {
            assert!((found.share - all.share).abs() < 0.02, "{machines}: {found:?}, not {all:?}");
        }
    }
}

#[test]
fn machines_that_do_not_help_do_not_harm() {
    for job in [job(1, 4096), job(40, 256)] {
        let seconds = [60, 100, 200, 1000, 4000]
            .map(|machines| predict(&farm(machines), &Costs::default(), &of(job.clone())).seconds);
        let best = seconds.into_iter().fold(f64::INFINITY, f64::min);
        assert!(seconds[4] < 1.3 * best && seconds[3] < 1.3 * best, "{seconds:?}");
    }
}
