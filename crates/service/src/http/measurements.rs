//! The measurements that `GET /metrics` shows: what each is of, and the bounds of their histograms.

use metrics_exporter_prometheus::{BuildError, Matcher, PrometheusBuilder, PrometheusHandle};

/// The kind of a measurement.
#[derive(Clone, Copy, Debug)]
enum Kind {
    /// Only grows.
    Counter,
    /// Goes up and down.
    Gauge,
    /// Times in seconds, counted in these bounds.
    Histogram(&'static [f64]),
}

use Kind::{Counter, Gauge, Histogram};

/// Bounds of times: requests, units, jobs, tiles of live views.
const REQUESTS: &[f64] = &[0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0];
const UNITS: &[f64] = &[0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0];
const JOBS: &[f64] =
    &[1.0, 3.0, 10.0, 30.0, 60.0, 180.0, 600.0, 1800.0, 3600.0, 14_400.0, 43_200.0, 86_400.0];
const TILES: &[f64] = &[0.005, 0.01, 0.02, 0.03, 0.05, 0.08, 0.15, 0.3, 1.0];

/// Names, kinds and descriptions.
const ALL: [(&str, Kind, &str); 30] = [
    ("raystream_build_info", Gauge, "1, with the version of the program as a label."),
    (
        "raystream_connections_closed_for_others_total",
        Counter,
        "Silent connections closed to make room for others.",
    ),
    ("raystream_data_folder_free_bytes", Gauge, "Bytes that are free where the data folder lies."),
    ("raystream_data_folder_refuses", Gauge, "1 while the data folder cannot be written, else 0."),
    ("raystream_deliveries", Gauge, "Deliveries of webhooks by state."),
    ("raystream_expired_jobs_total", Counter, "Jobs deleted by age or by bytes."),
    ("raystream_http_request_seconds", Histogram(REQUESTS), "Time of requests by route, method and code."),
    ("raystream_job_seconds", Histogram(JOBS), "Time from the request of a job to its end, by state."),
    ("raystream_job_wait_seconds", Histogram(JOBS), "Time from the request of a job to its first unit."),
    ("raystream_jobs", Gauge, "Jobs in the ledger by state."),
    ("raystream_known_requests_total", Counter, "Requests answered with a job that was there."),
    ("raystream_live_tile_bytes_total", Counter, "Bytes of live views' tiles from workers."),
    ("raystream_live_tile_seconds", Histogram(TILES), "Time of a live view's tile from a worker."),
    ("raystream_live_tiles_total", Counter, "Tiles of live views by result."),
    (
        "raystream_oldest_waiting_seconds",
        Gauge,
        "Age of the oldest job that has not begun; 0 if there is none.",
    ),
    ("raystream_rays_total", Counter, "Rays traced by this process."),
    ("raystream_redeliveries_total", Counter, "Units given to a worker once more."),
    ("raystream_refused_messages_total", Counter, "Messages of workers refused, by reason."),
    ("raystream_refused_tokens_total", Counter, "Requests refused for their token."),
    ("raystream_scene_cache_bytes", Gauge, "Bytes of scenes that are kept ready in memory."),
    ("raystream_scene_memory_bytes", Gauge, "Bytes that scenes take: kept ready, in use, being read."),
    ("raystream_storage_refuses", Gauge, "1 while the storage of results cannot be used, else 0."),
    ("raystream_unit_seconds", Histogram(UNITS), "Time that a worker took for a unit."),
    ("raystream_units_compared_total", Counter, "Units rendered by two workers, by result."),
    ("raystream_units_offered_again_total", Counter, "Units whose holder fell silent."),
    ("raystream_units_outstanding", Gauge, "Units that workers may have, or have."),
    ("raystream_units_total", Counter, "Units that came back, by result."),
    ("raystream_uploaded_bytes_total", Counter, "Bytes of uploaded scenes."),
    ("raystream_webhook_calls_total", Counter, "Calls of webhooks by result."),
    ("raystream_workers", Gauge, "Workers by state."),
];

/// Starts to record. Times are histograms, which can be added up over machines.
///
/// # Errors
/// None, as long as each histogram has bounds.
pub fn record() -> Result<PrometheusHandle, BuildError> {
    let builder = ALL.iter().try_fold(PrometheusBuilder::new(), |builder, (name, kind, _)| match kind {
        Histogram(bounds) => builder.set_buckets_for_metric(Matcher::Full((*name).into()), bounds),
        Counter | Gauge => Ok(builder),
    });
    let recorder = builder?.build_recorder();
    let handle = recorder.handle();
    // A process has one recorder; a second service of a test shares it.
    let _ = metrics::set_global_recorder(recorder);
    describe();
    Ok(handle)
}

/// Says what the measurements are of. Those that alerts look at have a value from the start.
fn describe() {
    for (name, kind, help) in ALL {
        match kind {
            Counter => metrics::describe_counter!(name, help),
            Gauge => metrics::describe_gauge!(name, help),
            Histogram(_) => metrics::describe_histogram!(name, help),
        }
    }
    metrics::gauge!("raystream_build_info", "version" => env!("CARGO_PKG_VERSION")).set(1.0);
    for name in ["raystream_data_folder_refuses", "raystream_storage_refuses"] {
        metrics::gauge!(name).set(0.0);
    }
    for name in ["raystream_refused_tokens_total", "raystream_known_requests_total", "raystream_rays_total"] {
        metrics::counter!(name).increment(0);
    }
    for result in ["failed", "delivered"] {
        metrics::counter!("raystream_webhook_calls_total", "result" => result).increment(0);
    }
    metrics::counter!("raystream_units_total", "result" => "done").increment(0);
}
