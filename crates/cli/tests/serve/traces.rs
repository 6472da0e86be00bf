//! Traces of jobs, as a collector receives them.

use crate::service::PATIENCE;
use crate::webhooks::{OWN, receiver};
use crate::{Service, folder, shipped};
use opentelemetry_proto::tonic::collector::trace::v1::ExportTraceServiceRequest;
use opentelemetry_proto::tonic::common::v1::any_value::Value as Kind;
use opentelemetry_proto::tonic::trace::v1::Span;
use prost::Message;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant, SystemTime};

/// A collector of traces.
#[derive(Clone, Default)]
struct Collector {
    spans: Arc<Mutex<Vec<Span>>>,
    /// The names of services.
    services: Arc<Mutex<Vec<String>>>,
    /// All that was received, as text.
    bytes: Arc<Mutex<String>>,
}

impl Collector {
    /// Starts one; returns its address, too.
    fn start() -> (String, Self) {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let url = format!("http://{}", listener.local_addr().expect("an address"));
        let own = Self::default();
        let collector = own.clone();
        std::thread::spawn(move || {
            for stream in listener.incoming() {
                let own = own.clone();
                std::thread::spawn(move || own.receive(stream.expect("a connection")));
            }
        });
        (url, collector)
    }

    /// Answers the requests of a connection.
    fn receive(&self, stream: TcpStream) {
        let mut reader = BufReader::new(stream);
        loop {
            let head = reader.by_ref().lines().map_while(Result::ok).take_while(|line| !line.is_empty());
            let head: Vec<String> = head.map(|line| line.to_lowercase()).collect();
            let Some(first) = head.first() else { return };
            assert!(first.starts_with("post /v1/traces "), "{first}");
            assert!(head.contains(&"content-type: application/x-protobuf".to_owned()), "{head:?}");
            let length = head.iter().find_map(|line| line.strip_prefix("content-length: "));
            let mut body = vec![0; length.expect("a length").parse().expect("a number")];
            reader.read_exact(&mut body).expect("a body");
            self.keep(&body);
            let answer =
                b"HTTP/1.1 200 OK\r\nContent-Type: application/x-protobuf\r\nContent-Length: 0\r\n\r\n";
            if reader.get_mut().write_all(answer).is_err() {
                return;
            }
        }
    }

    fn keep(&self, body: &[u8]) {
        self.bytes.lock().expect("no panic").push_str(&String::from_utf8_lossy(body));
        let request = ExportTraceServiceRequest::decode(body).expect("protobuf");
        for resource in request.resource_spans {
            for attribute in resource.resource.expect("a resource").attributes {
                if attribute.key == "service.name"
                    && let Some(Kind::StringValue(name)) = attribute.value.and_then(|value| value.value)
                {
                    self.services.lock().expect("no panic").push(name);
                }
            }
            let spans = resource.scope_spans.into_iter().flat_map(|scope| scope.spans);
            self.spans.lock().expect("no panic").extend(spans);
        }
    }

    /// The spans of a job, once there are so many calls among them.
    fn spans_of(&self, job: &str, calls: usize) -> Vec<Span> {
        let began = Instant::now();
        loop {
            let spans: Vec<Span> = self.spans.lock().expect("no panic").clone();
            let spans: Vec<Span> =
                spans.into_iter().filter(|span| attribute(span, "raystream.job") == job).collect();
            let count = |name: &str| spans.iter().filter(|span| span.name == name).count();
            if count("job") > 0 && count("delivery") >= calls {
                return spans;
            }
            assert!(began.elapsed() < Duration::from_secs(60), "{spans:?}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}

/// An attribute as JSON; null if there is none.
fn attribute(span: &Span, key: &str) -> Value {
    let found = span.attributes.iter().find(|attribute| attribute.key == key);
    match found.and_then(|attribute| attribute.value.clone()).and_then(|value| value.value) {
        Some(Kind::StringValue(text)) => json!(text),
        Some(Kind::IntValue(number)) => json!(number),
        Some(Kind::BoolValue(is_so)) => json!(is_so),
        Some(other) => panic!("{key}: {other:?}"),
        None => Value::Null,
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Starts a service that sends spans soon.
fn traced(data: &Path, url: &str, more: &[(&str, &str)]) -> Service {
    let variables = [("OTEL_EXPORTER_OTLP_ENDPOINT", url), ("OTEL_BSP_SCHEDULE_DELAY", "100")];
    Service::start_in(data, &OWN, &[&variables[..], more].concat())
}

/// Submits a job of three frames as a part of a span; returns its name.
fn submit(service: &Service, scene: &str, parent: &str, hook: &str) -> String {
    let mut job = json!({ "scene": scene, "size": "32x32", "spp": 8, "frames": "0..3", "turntable": 120,
        "title": "a secret title" });
    if !hook.is_empty() {
        job["webhook"] = json!({ "url": hook, "secret": "a secret key" });
    }
    let headers =
        [("Content-Type", "application/json"), ("traceparent", parent), ("Cache-Control", "no-cache")];
    let answer = service.send("POST", "/api/v1/jobs", &headers, job.to_string().into_bytes());
    assert_eq!(answer.status, 202, "{}", answer.json());
    answer.json()["id"].as_str().expect("an id").to_owned()
}

const TRACE: &str = "0af7651916cd43dd8448eb211c80319c";
const PARENT: &str = "b7ad6b7169203331";

#[test]
fn a_collector_gets_a_tree_of_spans_of_a_job() {
    let (data, (url, collector)) = (folder(), Collector::start());
    let service = traced(data.path(), &url, &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let (hook, _calls) = receiver(&[500, 200]);
    let id = submit(&service, &scene, &format!("00-{TRACE}-{PARENT}-01"), &format!("{hook}?secret=word"));
    service.hashes(&id);
    let spans = collector.spans_of(&id, 2);
    let of = |name: &str| spans.iter().filter(|span| span.name == name).collect::<Vec<_>>();
    let [job] = of("job")[..] else { panic!("one job: {spans:?}") };
    assert_eq!((hex(&job.trace_id), hex(&job.parent_span_id)), (TRACE.into(), PARENT.into()));
    assert_eq!(attribute(job, "raystream.state"), "done");
    let is_within = |inner: &Span, outer: &Span| {
        outer.start_time_unix_nano <= inner.start_time_unix_nano
            && inner.start_time_unix_nano <= inner.end_time_unix_nano
            && inner.end_time_unix_nano <= outer.end_time_unix_nano
    };
    let frames = of("frame");
    assert_eq!(frames.len(), 3);
    for frame in &frames {
        assert!(frame.parent_span_id == job.span_id && is_within(frame, job), "{frame:?} {job:?}");
    }
    let units = of("unit");
    let counted = service.job(&id)["units_done"].as_u64().expect("a number");
    assert!(counted > 6 && units.len() as u64 == counted, "{} spans of {counted} units", units.len());
    for unit in &units {
        let frame = frames.iter().find(|frame| frame.span_id == unit.parent_span_id).expect("its frame");
        assert_eq!(attribute(unit, "raystream.frame"), attribute(frame, "raystream.frame"));
        assert!(is_within(unit, frame), "{unit:?} {frame:?}");
        let told = ["worker", "attempts", "compared"].map(|key| attribute(unit, &format!("raystream.{key}")));
        assert_eq!(told, [json!("this process"), json!(1), json!(false)]);
    }
    let calls = of("delivery");
    let failed: Vec<bool> =
        calls.iter().map(|call| call.status.as_ref().is_some_and(|s| s.code == 2)).collect();
    assert_eq!(failed, [true, false]);
    assert!(calls.iter().all(|call| call.parent_span_id == job.span_id));
    assert!(spans.iter().all(|span| hex(&span.trace_id) == TRACE));
    let ids: std::collections::BTreeSet<&[u8]> = spans.iter().map(|span| &*span.span_id).collect();
    assert_eq!(ids.len(), spans.len(), "each has an id of its own");

    // Nothing that a stranger may not know is sent.
    let sent = collector.bytes.lock().expect("no panic").clone();
    for secret in [&*service.token, "secret", "cornell", data.path().to_str().expect("UTF-8"), &*scene] {
        assert!(!sent.contains(secret), "{secret}");
    }
    assert!(collector.services.lock().expect("no panic").iter().all(|name| name == "raystream"));
}

#[test]
fn a_trace_goes_on_after_a_restart_and_the_variables_decide_what_is_sampled() {
    let (data, (url, collector)) = (folder(), Collector::start());
    let service = traced(data.path(), &url, &[("OTEL_SERVICE_NAME", "night")]);
    let scene = service.upload_file(&shipped("cornell.json"));
    // Whoever asks can say that its trace is not sampled.
    let silent = submit(&service, &scene, &format!("00-{TRACE}-{PARENT}-00"), "");
    let root = submit(&service, &scene, "what is none", "");
    service.hashes(&silent);
    service.hashes(&root);
    let spans = collector.spans_of(&root, 0);
    let job = spans.iter().find(|span| span.name == "job").expect("the job");
    assert!(job.parent_span_id.is_empty());
    assert!(spans.iter().all(|span| span.trace_id == job.trace_id), "{spans:?}");
    let is_silent = |span: &Span| attribute(span, "raystream.job") == *silent;
    assert!(!collector.spans.lock().expect("no panic").iter().any(is_silent));
    assert!(collector.services.lock().expect("no panic").iter().all(|name| name == "night"));

    let long = json!({ "size": "48x48", "spp": 256, "frames": "0..5", "turntable": 60 });
    let broken = service.submit(&scene, &long);
    let began = Instant::now();
    while service.job(&broken)["frames_done"] == 0 {
        assert!(began.elapsed() < PATIENCE);
        std::thread::sleep(Duration::from_millis(20));
    }
    let steer = |service: &Service, verb: &str| {
        assert_eq!(service.post(&format!("/api/v1/jobs/{broken}/{verb}"), &json!({})).status, 200, "{verb}");
    };
    steer(&service, "pause");
    // Spans of the last moment are lost with the process.
    std::thread::sleep(Duration::from_millis(600));
    service.kill();
    let restarted = SystemTime::UNIX_EPOCH.elapsed().expect("a clock").as_nanos() as u64;
    let service = traced(data.path(), &url, &[]);
    steer(&service, "resume");
    service.hashes(&broken);
    let spans = collector.spans_of(&broken, 0);
    let job = spans.iter().find(|span| span.name == "job").expect("the job");
    let frames: Vec<&Span> = spans.iter().filter(|span| span.name == "frame").collect();
    let (before, after): (Vec<&Span>, Vec<&Span>) =
        frames.into_iter().partition(|frame| frame.end_time_unix_nano < restarted);
    assert!(!before.is_empty() && !after.is_empty(), "{before:?} {after:?}");
    let is_of_job = |frame: &&Span| frame.parent_span_id == job.span_id && frame.trace_id == job.trace_id;
    assert!(
        before.iter().chain(&after).copied().all(|frame| is_of_job(&frame)),
        "{job:?} {before:?} {after:?}"
    );
    assert!(job.start_time_unix_nano < restarted && restarted < job.end_time_unix_nano);
    drop(service);

    let off = [("OTEL_TRACES_SAMPLER", "always_off")];
    let service = traced(data.path(), &url, &off);
    let unsampled = submit(&service, &scene, "", "");
    service.hashes(&unsampled);
    std::thread::sleep(Duration::from_secs(1));
    let is_unsampled = |span: &Span| attribute(span, "raystream.job") == *unsampled;
    assert!(!collector.spans.lock().expect("no panic").iter().any(is_unsampled));
}

#[test]
fn a_collector_that_is_away_or_hangs_delays_no_job() {
    // It takes connections and never answers.
    let hanging = TcpListener::bind("127.0.0.1:0").expect("a port");
    let hanging = format!("http://{}", hanging.local_addr().expect("an address"));
    let time = |url: &str| {
        let data = folder();
        // Two spans at most wait.
        let few = [("OTEL_BSP_MAX_QUEUE_SIZE", "2"), ("OTEL_BSP_MAX_EXPORT_BATCH_SIZE", "1")];
        let mut service = traced(data.path(), url, &few);
        let scene = service.upload_file(&shipped("cornell.json"));
        let began = Instant::now();
        let id = submit(&service, &scene, "", "");
        service.hashes(&id);
        let taken = began.elapsed();
        let ended = Instant::now();
        let stopped = std::process::Command::new("kill").arg(service.process().to_string()).status();
        assert!(stopped.expect("kill runs").success());
        assert_eq!(service.wait_for_end(), Some(0));
        (taken, ended.elapsed())
    };
    let (alone, _) = time("");
    for url in ["http://127.0.0.1:1", &hanging] {
        let (taken, ending) = time(url);
        assert!(taken < 2 * alone + Duration::from_secs(5), "{url}: {taken:?}, alone {alone:?}");
        assert!(ending < Duration::from_secs(9), "{url}: it ends after {ending:?}");
    }
}
