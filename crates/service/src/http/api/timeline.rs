//! The timeline of a job over all machines, as Chrome trace events.
//!
//! Each worker is a process of the trace, with a line for each unit that it renders at the same time; process 0 is the
//! coordinator, which keeps sums and writes pictures. All times are the coordinator's, so clocks of workers do not
//! matter.

use crate::contract::Problem;
use crate::coordinator::ledger::{Event, EventsOf, Job, Rendering};
use crate::http::caller::Caller;
use crate::http::state::State;
use axum::Json;
use axum::extract::{Path, State as Given};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Events that are read at a time.
const READ: usize = 4096;

/// `GET /api/v1/jobs/{id}/timeline`.
pub async fn of_job(
    Given(state): Given<State>,
    caller: Caller,
    Path(id): Path<String>,
) -> Result<Json<Value>, Problem> {
    state
        .blocking(move |state| {
            let job = caller.job(state, &id)?;
            let scene_bytes = state.ledger().scene(&job.scene)?;
            let (mut trace, mut after) = (Trace::new(&job), 0);
            loop {
                let events = state.ledger().events(EventsOf::Job(&id), after, READ)?;
                events.iter().for_each(|event| trace.add(event));
                match events.last() {
                    Some(last) if events.len() == READ => after = last.seq,
                    _ => break,
                }
            }
            Ok(Json(trace.finish(&job, scene_bytes)))
        })
        .await
}

/// Lines of a process: when the last of the intervals on each ends. Intervals on one line do not overlap.
#[derive(Default)]
struct Lines(Vec<f64>);

impl Lines {
    /// The line of an interval, in milliseconds.
    fn of(&mut self, start: f64, end: f64) -> usize {
        let free = self.0.iter().position(|last| *last <= start);
        let line = free.unwrap_or(self.0.len());
        if free.is_none() {
            self.0.push(end);
        }
        self.0[line] = end;
        line
    }
}

/// A unit with sums.
struct Unit {
    frame: u64,
    pass: u64,
    number: u64,
    worker: String,
    kept_ms: f64,
    rendering: Rendering,
}

/// A timeline that grows by events.
struct Trace {
    created_ms: f64,
    units: Vec<Unit>,
    /// When the pictures of frames were written.
    frames: Vec<(u64, f64)>,
    /// What else happened to the job.
    changes: Vec<(String, f64)>,
}

impl Trace {
    fn new(job: &Job) -> Self {
        Self { created_ms: job.created_ms as f64, units: vec![], frames: vec![], changes: vec![] }
    }

    fn add(&mut self, event: &Event) {
        let at = event.time_ms as f64;
        let data: Value = serde_json::from_str(&event.data).unwrap_or_default();
        let number = |name: &str| data[name].as_u64().unwrap_or(0);
        match &*event.kind {
            "unit" => {
                // Services before this one wrote less.
                let Ok(rendering) = serde_json::from_value(data["rendering"].clone()) else { return };
                let worker = data["worker"].as_str().unwrap_or_default().to_owned();
                let (frame, pass, number) = (number("frame"), number("pass"), number("number"));
                self.units.push(Unit { frame, pass, number, worker, kept_ms: at, rendering });
            }
            "frame" => self.frames.push((number("frame"), at)),
            kind => self.changes.push((kind.to_owned(), at)),
        }
    }

    /// Microseconds since the job was submitted.
    fn us(&self, at_ms: f64) -> f64 {
        1e3 * (at_ms - self.created_ms)
    }

    fn interval(&self, name: &str, category: &str, place: (usize, usize), from: f64, to: f64) -> Value {
        json!({
            "name": name, "cat": category, "ph": "X", "pid": place.0, "tid": place.1,
            "ts": self.us(from), "dur": 1e3 * (to - from).max(0.0),
        })
    }

    fn finish(mut self, job: &Job, scene_bytes: Option<u64>) -> Value {
        self.units.sort_by(|a, b| a.rendering.began_ms.total_cmp(&b.rendering.began_ms));
        let mut workers: BTreeMap<&str, Lines> = BTreeMap::new();
        for unit in &self.units {
            workers.entry(&unit.worker).or_default();
        }
        let pids: BTreeMap<String, usize> =
            workers.keys().zip(1..).map(|(name, pid)| ((*name).to_owned(), pid)).collect();
        let mut events = vec![named(0, "coordinator")];
        events.extend(pids.iter().map(|(name, pid)| named(*pid, name)));
        for unit in &self.units {
            let Some(lines) = workers.get_mut(&*unit.worker) else { continue };
            let pid = pids.get(&unit.worker).copied().unwrap_or(0);
            let line = lines.of(unit.rendering.began_ms, unit.rendering.came_ms);
            events.extend(self.of_unit(unit, (pid, line)));
        }
        let slots = workers.values().map(|lines| lines.0.len()).max().unwrap_or(0);
        events.extend(self.of_coordinator());
        for (kind, at) in &self.changes {
            events.push(json!({ "name": kind, "ph": "i", "s": "g", "pid": 0, "tid": 0, "ts": self.us(*at) }));
        }
        let redeliveries: u64 =
            self.units.iter().map(|unit| unit.rendering.deliveries.saturating_sub(1)).sum();
        json!({
            "displayTimeUnit": "ms",
            "traceEvents": events,
            "otherData": {
                "job": job.id, "state": job.state, "kind": job.demand.kind, "size": job.demand.size,
                "spp": job.demand.spp, "frames": self.frames.len(), "scene": job.scene,
                "scene_bytes": scene_bytes, "workers": pids.len(), "units_at_once": slots,
                "units": self.units.len(), "redeliveries": redeliveries,
            },
        })
    }

    /// A unit, with opening its scene and sending its sums.
    fn of_unit(&self, unit: &Unit, place: (usize, usize)) -> Vec<Value> {
        let Unit { frame, pass, number, rendering, .. } = unit;
        let Rendering { began_ms, came_ms, seconds, opening_s, .. } = *rendering;
        let name = format!("frame {frame} unit {number}");
        let mut whole = self.interval(&name, "unit", place, began_ms, came_ms);
        let mut args = serde_json::to_value(rendering).unwrap_or_default();
        for (name, value) in [("frame", frame), ("pass", pass), ("unit", number)] {
            args[name] = (*value).into();
        }
        args["worker"] = unit.worker.clone().into();
        whole["args"] = args;
        // What the worker says is put where the coordinator saw it.
        let rendered = (began_ms + 1e3 * seconds).min(came_ms);
        let opened = (began_ms + 1e3 * opening_s).min(rendered);
        let mut events = vec![whole];
        if opening_s > 1e-3 {
            events.push(self.interval("open the scene", "opening", place, began_ms, opened));
        }
        events.push(self.interval("render", "rendering", place, opened, rendered));
        events.push(self.interval("send", "sending", place, rendered, came_ms));
        events
    }

    /// What the coordinator does: it keeps sums, and writes the pictures of frames once they have all.
    fn of_coordinator(&self) -> Vec<Value> {
        let mut kept: Vec<&Unit> = self.units.iter().collect();
        kept.sort_by(|a, b| a.rendering.came_ms.total_cmp(&b.rendering.came_ms));
        let (mut lines, mut last) = (Lines::default(), BTreeMap::<u64, f64>::new());
        let mut events = Vec::new();
        for unit in kept {
            let end = unit.kept_ms.max(unit.rendering.came_ms);
            let place = (0, lines.of(unit.rendering.came_ms, end));
            let name = format!("keep frame {} unit {}", unit.frame, unit.number);
            events.push(self.interval(&name, "keeping", place, unit.rendering.came_ms, end));
            let last = last.entry(unit.frame).or_insert(end);
            *last = last.max(end);
        }
        let mut pictures = Lines::default();
        for (frame, written) in &self.frames {
            let begun = last.get(frame).copied().unwrap_or(*written).min(*written);
            let place = (0, lines.0.len() + pictures.of(begun, *written));
            let mut event =
                self.interval(&format!("pictures of frame {frame}"), "pictures", place, begun, *written);
            event["args"] = json!({ "frame": frame });
            events.push(event);
        }
        events
    }
}

/// The name of a process of the trace.
fn named(pid: usize, name: &str) -> Value {
    json!({ "name": "process_name", "ph": "M", "pid": pid, "args": { "name": name } })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::{JobCost, StopRule};
    use crate::coordinator::ledger::JobState;
    use raystream::schedule::Priority;

    fn job() -> Job {
        Job {
            tenant: "t".into(),
            began_ms: None,
            seq: 1,
            id: "a1".into(),
            state: JobState::Done,
            request: "{}".into(),
            request_id: String::new(),
            trace_parent: String::new(),
            demand: JobCost::new((64, 32), 8, Some(1), StopRule::Samples),
            scene: "s".into(),
            priority: Priority::Normal,
            created_ms: 1_000_000,
            ended_ms: Some(1_004_000),
            error: None,
            is_planned: true,
            spent_ms: 0,
            is_pinned: false,
        }
    }

    fn event(seq: i64, kind: &str, time_ms: i64, data: &Value) -> Event {
        Event { seq, job: "a1".into(), time_ms, kind: kind.into(), data: data.to_string() }
    }

    /// A unit that began and came so many milliseconds after the job, and was kept 10 ms later.
    fn unit(number: u32, worker: &str, began: i64, came: i64, deliveries: u64) -> Event {
        let rendering = Rendering {
            began_ms: (1_000_000 + began) as f64,
            came_ms: (1_000_000 + came) as f64,
            seconds: (came - began) as f64 / 1e3 - 0.1,
            opening_s: if number == 0 { 0.5 } else { 0.0 },
            blocks: 2,
            samples: 4096,
            bytes: 100,
            deliveries,
        };
        let data =
            json!({ "frame": 0, "pass": 0, "number": number, "worker": worker, "rendering": rendering });
        event(i64::from(number) + 2, "unit", 1_000_010 + came, &data)
    }

    fn trace() -> Value {
        let mut trace = Trace::new(&job());
        trace.add(&event(1, "running", 1_000_100, &json!({ "frames": 1 })));
        for unit in [
            unit(0, "b", 1000, 2000, 1),
            unit(1, "b", 1500, 2500, 3),
            unit(2, "b", 2000, 3000, 1),
            unit(3, "a", 1200, 2600, 1),
        ] {
            trace.add(&unit);
        }
        // A service before this one wrote less of a unit.
        trace.add(&event(8, "unit", 1_003_000, &json!({ "frame": 0, "progress": {} })));
        trace.add(&event(9, "frame", 1_003_500, &json!({ "frame": 0 })));
        trace.add(&event(10, "done", 1_003_501, &json!({})));
        trace.finish(&job(), Some(123))
    }

    fn events<'a>(trace: &'a Value, category: &str) -> Vec<&'a Value> {
        let all = trace["traceEvents"].as_array().expect("events");
        all.iter().filter(|event| event["cat"] == category).collect()
    }

    #[test]
    fn units_lie_on_lines_of_their_workers() {
        let trace = trace();
        let units = events(&trace, "unit");
        let places: Vec<(u64, u64, f64, f64)> = units
            .iter()
            .map(|unit| {
                let number = |name: &str| unit[name].as_u64().expect("a number");
                let time = |name: &str| unit[name].as_f64().expect("a time");
                (number("pid"), number("tid"), time("ts"), time("dur"))
            })
            .collect();
        // Worker a is process 1, b is 2; the third unit of b begins when the first ends.
        let expected = [(2, 0, 1e6, 1e6), (1, 0, 1.2e6, 1.4e6), (2, 1, 1.5e6, 1e6), (2, 0, 2e6, 1e6)];
        assert_eq!(places, expected);
        assert_eq!(units[2]["args"]["deliveries"], 3);
        assert_eq!((&units[0]["args"]["worker"], &units[0]["args"]["bytes"]), (&"b".into(), &100.into()));
        let other = &trace["otherData"];
        assert_eq!((&other["redeliveries"], &other["units_at_once"]), (&2.into(), &2.into()));
        assert_eq!(
            (&other["workers"], &other["scene_bytes"], &other["units"]),
            (&2.into(), &123.into(), &4.into())
        );
    }

    #[test]
    fn parts_of_a_unit_lie_within_it() {
        let trace = trace();
        let [opening] = *events(&trace, "opening") else { panic!("one unit opens the scene") };
        assert_eq!((opening["ts"].as_f64(), opening["dur"].as_f64()), (Some(1e6), Some(5e5)));
        assert_eq!((events(&trace, "rendering").len(), events(&trace, "sending").len()), (4, 4));
        for part in events(&trace, "sending") {
            assert!((part["dur"].as_f64().expect("a time") - 1e5).abs() < 1.0, "{part}");
        }
    }

    #[test]
    fn the_coordinator_keeps_sums_and_writes_pictures() {
        let trace = trace();
        assert!(events(&trace, "keeping").iter().all(|event| event["dur"] == 1e4 && event["pid"] == 0));
        let [picture] = *events(&trace, "pictures") else { panic!("one frame") };
        assert_eq!((picture["ts"].as_f64(), picture["dur"].as_f64()), (Some(3.01e6), Some(4.9e5)));
        let instants = trace["traceEvents"].as_array().expect("events");
        let names: Vec<&Value> = instants.iter().filter(|e| e["ph"] == "i").map(|e| &e["name"]).collect();
        assert_eq!(names, ["running", "done"]);
    }
}
