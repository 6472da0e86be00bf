//! Timelines as Chrome trace events.

use super::{Timeline, name};
use raystream::schedule::Lengths;
use serde_json::{Value, json};

/// The timeline as JSON text.
pub fn text(timeline: &Timeline) -> String {
    let names = timeline.threads.iter().enumerate().map(|(thread, name)| {
        json!({ "name": "thread_name", "ph": "M", "pid": 1, "tid": thread, "args": { "name": name } })
    });
    let tasks = timeline.tasks.iter().map(|task| {
        json!({ "name": name(task.kind), "cat": "task", "ph": "X", "pid": 1, "tid": task.thread,
            "ts": task.start_ns as f64 / 1e3, "dur": (task.end_ns - task.start_ns) as f64 / 1e3,
            "args": { "rays": task.rays } })
    });
    let lists = timeline.lists().iter().flat_map(|task| {
        let Lengths { need_more, trace, shade, in_flight } = task.lists;
        [
            counter(
                "streams",
                task.end_ns,
                &json!({ "NEEDMORE": need_more, "TRACE": trace, "SHADE": shade }),
            ),
            counter("paths in flight", task.end_ns, &json!({ "paths": in_flight })),
        ]
    });
    let curves = timeline.curves.iter().flat_map(|curve| {
        let point =
            |&(at_ns, number): &(u64, f64)| counter(&curve.name, at_ns, &json!({ curve.unit: number }));
        curve.points.iter().map(point)
    });
    let events: Vec<Value> = names.chain(tasks).chain(lists).chain(curves).collect();
    json!({ "displayTimeUnit": "ms", "traceEvents": events }).to_string()
}

fn counter(name: &str, at_ns: u64, args: &Value) -> Value {
    json!({ "name": name, "ph": "C", "pid": 1, "ts": at_ns as f64 / 1e3, "args": args })
}
