//! Spans of jobs, frames, units and calls, made from the ledger's steps and sent to a collector.
//!
//! A span's id is drawn from what it is of, so that units name a job's span long before it ends, and a service that was
//! started again goes on with the same trace. All times are the coordinator's.

use crate::coordinator::ledger::{
    DueCall, Event, EventsOf, Job, JobState, Ledger, LedgerError, Rendering, now_ms,
};
use async_trait::async_trait;
use axum::http::HeaderMap;
use opentelemetry::propagation::TextMapPropagator;
use opentelemetry::trace::{
    Span, SpanBuilder, SpanContext, SpanId, SpanKind, Status, TraceContextExt, TraceFlags, TraceId,
    TraceState, Tracer, TracerProvider,
};
use opentelemetry::{Context, KeyValue};
use opentelemetry_http::{Bytes, HeaderExtractor, HttpClient, HttpError, Request, Response};
use opentelemetry_otlp::{
    OTEL_EXPORTER_OTLP_ENDPOINT, OTEL_EXPORTER_OTLP_TRACES_ENDPOINT, Protocol, SpanExporter,
    WithExportConfig, WithHttpConfig,
};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::propagation::TraceContextPropagator;
use opentelemetry_sdk::trace::{IdGenerator, SdkTracer, SdkTracerProvider};
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::cell::Cell;
use std::collections::HashMap;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime};
use ureq::Agent;
use ureq::tls::TlsConfig;

/// The name of the service, unless `OTEL_SERVICE_NAME` says another.
const SERVICE: &str = "raystream";

/// The longest time of a request to the collector.
const PATIENCE: Duration = Duration::from_secs(10);

/// How long the end of the service waits for the last spans.
const GRACE: Duration = Duration::from_secs(2);

/// Bytes of a collector's answer that are read.
const ANSWER_BYTES: u64 = 64 << 10;

/// Steps that are read at a time.
const READ: usize = 1000;

/// The span that a request is a part of, as the ledger keeps it: a `traceparent` (W3C Trace Context); empty if the
/// request names none.
pub fn parent(headers: &HeaderMap) -> String {
    let context = TraceContextPropagator::new().extract(&HeaderExtractor(headers));
    let span = context.span();
    let parent = span.span_context();
    if !parent.is_valid() {
        return String::new();
    }
    format!("00-{}-{}-{:02x}", parent.trace_id(), parent.span_id(), parent.trace_flags().to_u8())
}

/// The context of what [`parent`] has returned.
fn context_of(parent: &str) -> Context {
    let headers = HashMap::from([("traceparent".to_owned(), parent.to_owned())]);
    TraceContextPropagator::new().extract_with_context(&Context::new(), &headers)
}

/// The spans of jobs. Whoever makes one never waits for the collector: what it has no room for is dropped.
pub struct Traces(Option<On>);

struct On {
    provider: SdkTracerProvider,
    tracer: SdkTracer,
    /// Decides as the other which traces are sampled, and sends nothing.
    sampler: SdkTracer,
    /// When the first unit of each open frame began, in milliseconds since 1970, by job.
    begun: Mutex<HashMap<String, HashMap<u32, f64>>>,
}

impl Traces {
    /// Traces as the standard variables of the environment (`OTEL_*`) say; none unless they name an endpoint.
    ///
    /// # Errors
    /// If a variable says what cannot be done.
    pub fn of_environment(tls: &TlsConfig) -> io::Result<Self> {
        let variable = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
        let endpoints = [OTEL_EXPORTER_OTLP_ENDPOINT, OTEL_EXPORTER_OTLP_TRACES_ENDPOINT];
        let is_off = variable("OTEL_SDK_DISABLED").is_some_and(|value| value.eq_ignore_ascii_case("true"))
            || variable("OTEL_TRACES_EXPORTER").is_some_and(|value| value == "none");
        if is_off || !endpoints.into_iter().any(|name| variable(name).is_some()) {
            return Ok(Self(None));
        }
        let exporter = SpanExporter::builder().with_http().with_protocol(Protocol::HttpBinary);
        let exporter = exporter.with_http_client(Collector::new(tls)).build();
        let exporter = exporter.map_err(|error| io::Error::other(format!("OTEL_EXPORTER_OTLP: {error}")))?;
        let mut resource = Resource::builder();
        if variable("OTEL_SERVICE_NAME").is_none() {
            resource = resource.with_service_name(SERVICE);
        }
        let resource = resource.build();
        let provider = SdkTracerProvider::builder().with_id_generator(Ids).with_resource(resource);
        let provider = provider.with_batch_exporter(exporter).build();
        let sampler = SdkTracerProvider::builder().with_id_generator(Ids).build().tracer(SERVICE);
        let tracer = provider.tracer(SERVICE);
        Ok(Self(Some(On { provider, tracer, sampler, begun: Mutex::default() })))
    }

    /// Makes the span that ends with a step of a job: a unit's, a frame's, or the job's own.
    ///
    /// # Errors
    /// If the ledger cannot be read.
    pub fn step(&self, ledger: &Ledger, step: &Event, job: &Job) -> Result<(), LedgerError> {
        self.0.as_ref().map_or(Ok(()), |on| on.step(ledger, step, job))
    }

    /// Makes the span of a call, which began at a time in milliseconds since 1970 and ends now.
    pub fn called(&self, job: &Job, due: &DueCall, began_ms: i64, has_failed: bool) {
        let Some(on) = &self.0 else { return };
        let Some(parent) = on.context(job) else { return };
        let call = due.attempts + 1;
        let attributes = vec![
            KeyValue::new("raystream.job", job.id.clone()),
            KeyValue::new("raystream.delivery", due.id.clone()),
            KeyValue::new("raystream.call", i64::from(call)),
        ];
        let id = span_id(&format!("delivery {} {call}", due.id));
        let times = (began_ms as f64, now_ms() as f64);
        on.make("delivery", SpanKind::Client, (id, &parent), times, attributes, has_failed);
    }

    /// Sends what there is, and ends.
    pub fn end(&self) {
        if let Some(on) = &self.0
            && let Err(error) = on.provider.shutdown_with_timeout(GRACE)
        {
            log::debug!("the last spans were not sent: {error}");
        }
    }
}

impl On {
    /// The context in which the spans of a job's frames and calls are made; `None` if its trace is not sampled.
    fn context(&self, job: &Job) -> Option<Context> {
        NEXT.set((trace_id(&job.id), job_span(job)));
        let of_job =
            self.sampler.build_with_context(SpanBuilder::from_name("job"), &context_of(&job.trace_parent));
        let own = of_job.span_context();
        own.is_sampled()
            .then(|| Context::new().with_remote_span_context(local(own.trace_id(), own.span_id())))
    }

    fn step(&self, ledger: &Ledger, step: &Event, job: &Job) -> Result<(), LedgerError> {
        let has_ended = step.kind.parse::<JobState>().is_ok_and(JobState::has_ended);
        if !(has_ended || step.kind == "unit" || step.kind == "frame") {
            return Ok(());
        }
        let Some(of_job) = self.context(job) else { return Ok(()) };
        if has_ended {
            self.begun().remove(&job.id);
            self.end_job(step, job);
            return Ok(());
        }
        let mut begun = match self.begun().remove(&job.id) {
            Some(begun) => begun,
            None => began_before(ledger, step, job)?,
        };
        let data: Value = serde_json::from_str(&step.data).unwrap_or_default();
        let frame = data["frame"].as_u64().unwrap_or(0) as u32;
        let id = span_id(&format!("frame {} {frame}", job.id));
        if step.kind == "unit" {
            let times = unit_times(step, &data, job);
            let first = begun.entry(frame).or_insert(times.0);
            *first = first.min(times.0);
            let trace = of_job.span().span_context().trace_id();
            let parent = Context::new().with_remote_span_context(local(trace, id));
            self.end_unit(&data, job, &parent, times);
        } else {
            let began = begun.remove(&frame).unwrap_or_else(|| began_ms(job));
            let attributes = vec![
                KeyValue::new("raystream.job", job.id.clone()),
                KeyValue::new("raystream.frame", i64::from(frame)),
            ];
            let times = (began, step.time_ms as f64);
            self.make("frame", SpanKind::Internal, (id, &of_job), times, attributes, false);
        }
        self.begun().insert(job.id.clone(), begun);
        Ok(())
    }

    fn begun(&self) -> std::sync::MutexGuard<'_, HashMap<String, HashMap<u32, f64>>> {
        self.begun.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Makes a job's span. The reason of a failure may name files, so it stays out.
    fn end_job(&self, step: &Event, job: &Job) {
        NEXT.set((trace_id(&job.id), job_span(job)));
        let attributes = vec![
            KeyValue::new("raystream.job", job.id.clone()),
            KeyValue::new("raystream.tenant", job.tenant.clone()),
            KeyValue::new("raystream.request", job.request_id.clone()),
            KeyValue::new("raystream.state", step.kind.clone()),
            KeyValue::new("raystream.priority", job.priority.name()),
        ];
        let times = (job.created_ms as f64, step.time_ms as f64);
        let of = (job_span(job), &context_of(&job.trace_parent));
        self.make("job", SpanKind::Server, of, times, attributes, step.kind == JobState::Failed.name());
    }

    fn end_unit(&self, data: &Value, job: &Job, parent: &Context, times: (f64, f64)) {
        let number = |value: &Value| value.as_i64().unwrap_or(0);
        let attributes = vec![
            KeyValue::new("raystream.job", job.id.clone()),
            KeyValue::new("raystream.frame", number(&data["frame"])),
            KeyValue::new("raystream.unit", format!("{}.{}", data["pass"], data["number"])),
            KeyValue::new("raystream.worker", data["worker"].as_str().unwrap_or_default().to_owned()),
            KeyValue::new("raystream.attempts", number(&data["rendering"]["deliveries"])),
            KeyValue::new("raystream.compared", data["compared"].as_bool().unwrap_or(false)),
            KeyValue::new("raystream.samples", number(&data["rendering"]["samples"])),
        ];
        let of = format!("unit {} {} {} {} {}", job.id, data["frame"], data["pass"], data["number"], times.1);
        self.make("unit", SpanKind::Internal, (span_id(&of), parent), times, attributes, false);
    }

    /// Makes a span of a time in milliseconds since 1970.
    fn make(
        &self,
        name: &'static str,
        kind: SpanKind,
        (id, parent): (SpanId, &Context),
        (began_ms, ended_ms): (f64, f64),
        attributes: Vec<KeyValue>,
        has_failed: bool,
    ) {
        let job = attributes.first().map(|job| job.value.to_string()).unwrap_or_default();
        NEXT.set((trace_id(&job), id));
        let builder = SpanBuilder::from_name(name).with_kind(kind).with_start_time(time(began_ms));
        let mut span = self.tracer.build_with_context(builder.with_attributes(attributes), parent);
        if has_failed {
            span.set_status(Status::error(""));
        }
        span.end_with_timestamp(time(ended_ms.max(began_ms)));
    }
}

/// When the frames of a job had begun before a step, in milliseconds since 1970.
fn began_before(ledger: &Ledger, step: &Event, job: &Job) -> Result<HashMap<u32, f64>, LedgerError> {
    let (mut begun, mut after) = (HashMap::new(), 0);
    loop {
        let steps = ledger.events(EventsOf::Job(&job.id), after, READ)?;
        for earlier in steps.iter().filter(|earlier| earlier.kind == "unit" && earlier.seq < step.seq) {
            let data: Value = serde_json::from_str(&earlier.data).unwrap_or_default();
            let began = unit_times(earlier, &data, job).0;
            let first = begun.entry(data["frame"].as_u64().unwrap_or(0) as u32).or_insert(began);
            *first = began.min(*first);
        }
        match steps.last() {
            Some(last) if steps.len() == READ && last.seq < step.seq => after = last.seq,
            _ => return Ok(begun),
        }
    }
}

/// The time of a unit, within that of its job.
fn unit_times(step: &Event, data: &Value, job: &Job) -> (f64, f64) {
    let rendering: Rendering = serde_json::from_value(data["rendering"].clone()).unwrap_or_default();
    let ended = rendering.came_ms.min(step.time_ms as f64).max(began_ms(job));
    (rendering.began_ms.clamp(began_ms(job), ended), ended)
}

/// The time at which a job's first unit could begin.
fn began_ms(job: &Job) -> f64 {
    job.began_ms.unwrap_or(job.created_ms) as f64
}

fn time(ms: f64) -> SystemTime {
    SystemTime::UNIX_EPOCH + Duration::from_secs_f64(ms.max(0.0) / 1000.0)
}

/// A span of this process in a trace that is sampled.
fn local(trace: TraceId, id: SpanId) -> SpanContext {
    SpanContext::new(trace, id, TraceFlags::SAMPLED, false, TraceState::NONE)
}

/// The trace of a job that no other span is above.
fn trace_id(job: &str) -> TraceId {
    TraceId::from_bytes(start_of_hash(&format!("trace {job}")))
}

fn job_span(job: &Job) -> SpanId {
    span_id(&format!("job {}", job.id))
}

fn span_id(of: &str) -> SpanId {
    SpanId::from_bytes(start_of_hash(of))
}

fn start_of_hash<const N: usize>(text: &str) -> [u8; N] {
    let hash = Sha256::digest(text.as_bytes());
    std::array::from_fn(|place| hash[place])
}

thread_local! {
    /// The ids of the span that this thread makes next.
    static NEXT: Cell<(TraceId, SpanId)> = const { Cell::new((TraceId::INVALID, SpanId::INVALID)) };
}

/// Gives spans the ids that were chosen for them.
#[derive(Debug)]
struct Ids;

impl IdGenerator for Ids {
    fn new_trace_id(&self) -> TraceId {
        NEXT.get().0
    }

    fn new_span_id(&self) -> SpanId {
        NEXT.get().1
    }
}

/// The way to the collector.
#[derive(Debug)]
struct Collector {
    agent: Agent,
    /// True if the last request has failed: the log says so once.
    is_lost: AtomicBool,
}

impl Collector {
    fn new(tls: &TlsConfig) -> Self {
        let config = Agent::config_builder()
            .timeout_global(Some(PATIENCE))
            .max_redirects(0)
            .http_status_as_error(false)
            .tls_config(tls.clone());
        Self { agent: config.build().new_agent(), is_lost: AtomicBool::new(false) }
    }

    fn send(&self, request: Request<Bytes>) -> Result<Response<Bytes>, ureq::Error> {
        let (parts, body) = request.into_parts();
        let answer = self.agent.run(Request::from_parts(parts, body.to_vec()))?;
        let (parts, mut body) = answer.into_parts();
        let body = body.with_config().limit(ANSWER_BYTES).read_to_vec()?;
        Ok(Response::from_parts(parts, body.into()))
    }
}

#[async_trait]
impl HttpClient for Collector {
    /// Sends on the thread that has nothing else to do.
    async fn send_bytes(&self, request: Request<Bytes>) -> Result<Response<Bytes>, HttpError> {
        let answer = self.send(request);
        let trouble = match &answer {
            Ok(answer) if answer.status().is_success() => None,
            Ok(answer) => Some(format!("the answer was {}", answer.status())),
            Err(error) => Some(error.to_string()),
        };
        let was_lost = self.is_lost.swap(trouble.is_some(), SeqCst);
        match trouble {
            Some(trouble) if !was_lost => log::warn!("traces do not reach their collector: {trouble}"),
            None if was_lost => log::info!("traces reach their collector again"),
            _ => {}
        }
        Ok(answer?)
    }
}
