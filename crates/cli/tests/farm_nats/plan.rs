//! Timelines of jobs over many machines, and what is predicted from them.

use crate::service::raystream;
use crate::{Nats, Worker, coordinator, folder, shipped};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::Path;

/// Runs raystream and returns its exit code and all that it printed.
fn run(arguments: &[&str]) -> (Option<i32>, String) {
    let output = raystream(arguments);
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout) + &text(&output.stderr))
}

fn read(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).expect("a file")).expect("JSON")
}

fn utf8(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

#[test]
fn the_timeline_of_a_job_shows_all_machines_and_predicts_others() {
    let (nats, data, work) = (Nats::start(), folder(), folder());
    let service = coordinator(data.path(), &nats.url(), &[]);
    let _workers = Worker::some(&nats.url(), 2);
    let began = std::time::Instant::now();
    while service.get("/api/v1/workers").json()["workers"].as_array().map_or(0, Vec::len) < 2 {
        assert!(began.elapsed().as_secs() < 60, "the workers do not join");
    }
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &json!({ "size": "64x48", "spp": 64 }));
    service.hashes(&id);
    let (timeline, token) = (work.path().join("t.json"), data.path().join("token"));
    let place = ["--server", &service.url, "--token-file", utf8(&token)];
    let (code, text) = run(&[&["timeline", &id, "-o", utf8(&timeline)][..], &place].concat());
    assert_eq!(code, Some(0), "{text}");
    let trace = read(&timeline);
    let events = trace["traceEvents"].as_array().expect("events");
    let units: Vec<&Value> = events.iter().filter(|event| event["cat"] == "unit").collect();
    let samples: u64 = units.iter().map(|unit| unit["args"]["samples"].as_u64().expect("samples")).sum();
    assert_eq!(samples, 64 * 48 * 64, "each sample is in one unit");
    let workers: BTreeSet<&str> =
        units.iter().map(|unit| unit["args"]["worker"].as_str().expect("a name")).collect();
    assert_eq!(workers.into_iter().collect::<Vec<_>>(), ["w0", "w1"]);
    let end = |event: &Value| event["ts"].as_f64().expect("ts") + event["dur"].as_f64().expect("dur");
    let picture = events.iter().find(|event| event["cat"] == "pictures").expect("a frame");
    // The ledger's times are whole milliseconds.
    assert!(units.iter().all(|unit| unit["ts"].as_f64() > Some(0.0) && end(unit) <= end(picture) + 2e3));
    assert!(units.iter().all(|unit| unit["args"]["bytes"].as_u64() > Some(12 * 256 * 28)));

    let plan = work.path().join("plan.json");
    let arguments =
        ["farm", "plan", "--from-job", utf8(&timeline), "--machines", "1,2,4", "--json", utf8(&plan)];
    let (code, text) = run(&arguments);
    assert_eq!(code, Some(0), "{text}");
    let plan = read(&plan);
    let pixel_bytes = plan["costs"]["pixel_bytes"].as_f64().expect("a number");
    assert!((28.0..28.1).contains(&pixel_bytes), "{pixel_bytes}");
    let rows = plan["rows"].as_array().expect("rows");
    assert_eq!((rows.len(), &rows[1]["machines"], &rows[1]["job"]), (3, &2.into(), &id.into()));
}

#[test]
fn predictions_are_printed_drawn_and_written() {
    let work = folder();
    let (json_path, plot) = (work.path().join("p.json"), work.path().join("p.svg"));
    let small =
        ["farm", "plan", "--machines", "20", "--job", "still,live", "--spp", "8", "--size", "640x360"];
    let files = ["--json", utf8(&json_path), "--plot", utf8(&plot)];
    let (code, text) = run(&[&small[..], &files].concat());
    assert!(code == Some(0) && text.contains("efficiency") && text.contains("live"), "{text}");
    let sheet = read(&json_path);
    let machines: Vec<u64> = sheet["rows"]
        .as_array()
        .expect("rows")
        .iter()
        .map(|row| row["machines"].as_u64().expect("a number"))
        .collect();
    assert_eq!(machines, [1, 2, 5, 10, 20, 1, 2, 5, 10, 20]);
    assert!(std::fs::read_to_string(&plot).expect("a plot").contains("machines"));
    // What --json shows of costs can be given back.
    let again = work.path().join("q.json");
    let from_file = ["--costs", utf8(&json_path), "--cost", "slots=1", "--json", utf8(&again)];
    let (code, text) = run(&[&small[..], &from_file].concat());
    assert_eq!(code, Some(0), "{text}");
    assert_eq!(read(&again)["costs"]["slots"], 1);
}

#[test]
fn plans_that_make_no_sense_are_refused() {
    let work = folder();
    let (wrong, unknown) = (work.path().join("w.json"), work.path().join("u.json"));
    std::fs::write(&wrong, "{").expect("a file");
    std::fs::write(&unknown, "{\"speed\": 3}").expect("a file");
    let refused: [(&[&str], &str); 10] = [
        (&["--machines", "0"], "0"),
        (&["--network", "0"], "gigabits"),
        (&["--cost", "speed=3"], "samples_per_second"),
        (&["--cost", "read_s=x"], "no number"),
        (&["--cost", "slots=1.5"], "--cost"),
        (&["--cost", "lease_s=0"], "lease_s"),
        (&["--costs", utf8(&wrong)], "no JSON"),
        (&["--costs", utf8(&unknown)], "speed"),
        (&["--from-job", utf8(&unknown)], "timeline"),
        (&["--plot", "p.png"], ".svg"),
    ];
    for (arguments, part) in refused {
        let (code, text) = run(&[&["farm", "plan"], arguments].concat());
        assert!(code == Some(2) && text.contains(part), "{arguments:?}: {text}");
    }
}
