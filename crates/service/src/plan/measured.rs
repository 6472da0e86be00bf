//! What a job of the service has cost, from its timeline (`raystream timeline`).

use super::costs::{Costs, FramesJob};
use crate::coordinator::decisions::BLOCK_PIXELS;
use raystream::render::Blocks;
use raystream::schedule::Priority;
use serde_json::Value;
use std::collections::BTreeMap;

/// An interval of the timeline, in seconds since the job was submitted.
struct Interval<'a> {
    start: f64,
    end: f64,
    place: (u64, u64),
    event: &'a Value,
}

/// The intervals of a category, by when they begin.
fn intervals<'a>(trace: &'a Value, category: &str) -> Vec<Interval<'a>> {
    let of_category = |event: &&Value| event["cat"] == category && event["ph"] == "X";
    let interval = |event: &'a Value| {
        let start = event["ts"].as_f64()? * 1e-6;
        let place = (event["pid"].as_u64()?, event["tid"].as_u64()?);
        Some(Interval { start, end: start + event["dur"].as_f64()? * 1e-6, place, event })
    };
    let events = trace["traceEvents"].as_array().into_iter().flatten();
    let mut all: Vec<Interval<'a>> = events.filter(of_category).filter_map(interval).collect();
    all.sort_by(|a, b| a.start.total_cmp(&b.start));
    all
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// The time in which at least one of some intervals is under way; they are sorted by when they begin.
fn together(intervals: &[&Interval<'_>]) -> f64 {
    let (mut all, mut until) = (0.0, f64::NEG_INFINITY);
    for interval in intervals {
        all += (interval.end - interval.start.max(until)).max(0.0);
        until = until.max(interval.end);
    }
    all
}

/// Reads what a job was and what it has cost. Costs that its timeline does not tell stay as they are.
///
/// The coordinator is taken for as fast as a machine. A machine's speed contains what its units took besides their
/// samples, so that is 0 then. What the coordinator took for a unit's sums does not depend on their bytes then.
///
/// # Errors
/// What the timeline lacks.
pub fn measured(trace: &Value, before: &Costs) -> Result<(Costs, FramesJob), String> {
    let other = &trace["otherData"];
    let number = |name: &str| other[name].as_u64().ok_or(format!("it has no number {name:?}"));
    let size =
        other["size"].as_array().and_then(|size| Some((size.first()?.as_u64()?, size.get(1)?.as_u64()?)));
    let (width, height) = size.ok_or("it has no size")?;
    if other["kind"] != "samples" {
        return Err("its samples were not the same in each pixel; plan with a job of --spp alone".into());
    }
    let frames = number("frames")?.max(1) as u32;
    let job = FramesJob {
        name: other["job"].as_str().unwrap_or("job").to_owned(),
        size: (width as u32, height as u32),
        spp: number("spp")?.max(1) as u32,
        frames,
        priority: Priority::Normal,
    };
    let units = intervals(trace, "unit");
    if units.is_empty() {
        return Err("it has no units: wait until the job has ended".into());
    }
    let mut costs = Costs { unit_s: 0.0, keep_byte_s: 0.0, ..*before };
    costs.slots = number("units_at_once")?.clamp(1, 64) as u32;
    costs.scene_bytes = other["scene_bytes"].as_f64().unwrap_or(0.0);
    of_machines(trace, &units, &job, &mut costs)?;
    of_coordinator(trace, &units, &mut costs);
    Ok((costs, job))
}

/// What machines have taken.
fn of_machines(
    trace: &Value,
    units: &[Interval<'_>],
    job: &FramesJob,
    costs: &mut Costs,
) -> Result<(), String> {
    let argument = |interval: &Interval<'_>, name: &str| interval.event["args"][name].as_f64().unwrap_or(0.0);
    let samples: f64 = units.iter().map(|unit| argument(unit, "samples")).sum();
    let rendering = intervals(trace, "rendering");
    let mut by_worker: BTreeMap<u64, Vec<&Interval<'_>>> = BTreeMap::new();
    for interval in &rendering {
        by_worker.entry(interval.place.0).or_default().push(interval);
    }
    let busy: f64 = by_worker.values().map(|intervals| together(intervals)).sum();
    // Blocks at the edge of the picture count whole there.
    let pixels = f64::from(job.size.0) * f64::from(job.size.1);
    let pixels_of_block = pixels / Blocks::new(job.size.0, job.size.1).count() as f64;
    costs.samples_per_second = samples * pixels_of_block / BLOCK_PIXELS / busy;
    costs.coordinator_samples_per_second = costs.samples_per_second;
    if !(costs.samples_per_second.is_finite() && samples > 0.0) {
        return Err("its units have no samples or took no time".into());
    }
    let mut opening: BTreeMap<u64, f64> = BTreeMap::new();
    for unit in units {
        let most = opening.entry(unit.place.0).or_insert(0.0);
        *most = most.max(argument(unit, "opening_s"));
    }
    costs.read_s = median(opening.into_values().collect()).unwrap_or(costs.read_s);
    let bytes: f64 = units.iter().map(|unit| argument(unit, "bytes")).sum();
    let blocks: f64 = units.iter().map(|unit| argument(unit, "blocks")).sum();
    if blocks > 0.0 {
        costs.pixel_bytes = bytes / (blocks * pixels_of_block);
    }
    Ok(())
}

/// What the coordinator has taken.
fn of_coordinator(trace: &Value, units: &[Interval<'_>], costs: &mut Costs) {
    let kept = intervals(trace, "keeping").iter().map(|interval| interval.end - interval.start).collect();
    if let Some(kept) = median(kept) {
        costs.keep_s = (kept - costs.commit_s).max(0.0);
    }
    // From one unit of a line to the next: it is kept, its lease ends, another is leased.
    let mut last: BTreeMap<(u64, u64), f64> = BTreeMap::new();
    let mut pauses = Vec::new();
    for unit in units {
        if let Some(before) = last.insert(unit.place, unit.end) {
            pauses.push(unit.start - before);
        }
    }
    if let Some(pause) = median(pauses) {
        let trips = pause - costs.keep_s - costs.commit_s - 2.0 * costs.question_s;
        costs.round_trip_s = (trips / PAUSE_TRIPS).clamp(1e-5, 1.0);
    }
    let pictures = intervals(trace, "pictures");
    let writing = pictures.iter().map(|interval| interval.end - interval.start).collect();
    costs.finish_s = median(writing).unwrap_or(costs.finish_s);
    let events = trace["traceEvents"].as_array().into_iter().flatten();
    let running = events.filter(|event| event["name"] == "running").find_map(|event| event["ts"].as_f64());
    if let (Some(running), Some(first)) = (running, units.first()) {
        let running = running * 1e-6;
        costs.plan_s = (running - 2.0 * costs.look_s).max(0.0);
        costs.open_s = (first.start - running - 2.0 * costs.look_s - costs.commit_s).max(0.0);
    }
}

/// Round trips between a worker's last part of a unit and the start of its next: the answer, the end of the lease, the
/// next lease, the question whether to render.
const PAUSE_TRIPS: f64 = 4.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{Farm, PlannedJob, predict};
    use serde_json::json;

    /// The timeline of a job of one worker with one slot, whose units take a second each.
    fn trace(units: u32) -> Value {
        let interval = |name: &str, pid: u32, from: f64, to: f64| {
            let (ts, dur) = (1e6 * from, 1e6 * (to - from));
            json!({ "cat": name, "name": name, "ph": "X", "pid": pid, "tid": 0, "ts": ts, "dur": dur })
        };
        let mut events = vec![json!({ "name": "running", "ph": "i", "ts": 0.4e6 })];
        let mut at = 0.5;
        for number in 0..units {
            let opening = if number == 0 { 2.0 } else { 0.0 };
            let end = at + opening + 1.0 + 0.001;
            let mut unit = interval("unit", 1, at, end);
            unit["args"] = json!({
                "samples": 1_000_000, "bytes": 102_400, "blocks": 16, "opening_s": opening, "deliveries": 1,
            });
            events.push(unit);
            events.push(interval("rendering", 1, at + opening, at + opening + 1.0));
            events.push(interval("keeping", 0, end, end + 0.004));
            at = end + 0.010;
        }
        events.push(interval("pictures", 0, at, at + 0.7));
        json!({ "traceEvents": events, "otherData": {
            "job": "a1", "kind": "samples", "size": [320, 320], "spp": 100, "frames": 1, "scene_bytes": 5000,
            "units_at_once": 1,
        } })
    }

    #[test]
    fn costs_are_those_of_the_timeline() {
        let before = Costs { commit_s: 0.001, question_s: 0.0, ..Costs::default() };
        let (costs, job) = measured(&trace(10), &before).expect("a timeline");
        assert_eq!((job.size, job.spp, job.frames, costs.slots), ((320, 320), 100, 1, 1));
        let near =
            |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 1e-6, "{found}, {expected}");
        near(costs.samples_per_second, 1e6);
        near(costs.read_s, 2.0);
        near(costs.pixel_bytes, 25.0);
        near(costs.keep_s, 0.003);
        near(costs.round_trip_s, (0.010 - 0.004) / 4.0);
        near(costs.finish_s, 0.7);
        near(costs.plan_s, 0.4 - 2.0 * costs.look_s);
        assert_eq!(costs.problem(), None);
    }

    #[test]
    fn a_measured_job_is_predicted() {
        // 320 × 320 × 100 samples at 10⁶ a second take 10.24 s, so that ten such units are the whole job.
        let (costs, job) = measured(&trace(10), &Costs::default()).expect("a timeline");
        let costs = Costs { startup_s: 0.0, ..costs };
        let farm = Farm { machines: 1, network_bits: 1e9, failure_s: None, compared: 0.0 };
        let found = predict(&farm, &costs, &PlannedJob::Frames(job)).seconds;
        let took = 0.5 + 2.0 + 10.24 + 0.7;
        assert!((found / took - 1.0).abs() < 0.05, "{found} s, {took} s");
    }

    #[test]
    fn timelines_that_tell_nothing_are_refused() {
        let refused = |trace: &Value, part: &str| {
            let why = measured(trace, &Costs::default()).expect_err("it is refused");
            assert!(why.contains(part), "{why}");
        };
        refused(&json!({}), "size");
        refused(&trace(0), "no units");
        let mut noise = trace(3);
        noise["otherData"]["kind"] = "noise".into();
        refused(&noise, "--spp");
        let mut empty = trace(3);
        empty["otherData"].as_object_mut().expect("an object").remove("units_at_once");
        refused(&empty, "units_at_once");
    }
}
