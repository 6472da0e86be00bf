//! Whether the service lives, whether it can work, and what it has done.

use super::body;
use crate::contract::Problem;
use crate::coordinator::ShownWorker;
use crate::coordinator::ledger::{DeliveryCounts, now_ms};
use crate::coordinator::storage::Storage;
use crate::http::state::State;
use axum::Json;
use axum::body::Body;
use axum::extract::{Path, State as Given};
use axum::http::{StatusCode, header};
use axum::response::IntoResponse;
use serde_json::{Value, json};
use std::time::Duration;

/// How long `/readyz` waits for the storage: who asks waits less than those who use it.
const STORAGE: Duration = Duration::from_secs(5);

/// `GET /healthz`: the process answers.
pub async fn healthz() -> &'static str {
    "ok\n"
}

/// `GET /readyz`: the ledger answers too, the data folder can be written, the storage can be used if there is one, and
/// the service is not ending.
pub async fn readyz(Given(state): Given<State>) -> Result<&'static str, Problem> {
    if *state.ending().borrow() {
        return Err(Problem::new(StatusCode::SERVICE_UNAVAILABLE, "the service is ending"));
    }
    state
        .blocking(|state| {
            state.ledger().last_event()?;
            Ok(())
        })
        .await?;
    let stored = state.blocking(|state| Ok(state.store().storage().map_or(Ok(()), Storage::check)?));
    let late = |_| {
        let detail = format!("the storage has not answered for {} s", STORAGE.as_secs());
        Problem::new(StatusCode::SERVICE_UNAVAILABLE, detail)
    };
    tokio::time::timeout(STORAGE, stored).await.map_err(late)??;
    match state.runner().trouble.now() {
        None => Ok("ready\n"),
        Some(why) => Err(Problem::new(StatusCode::SERVICE_UNAVAILABLE, why)),
    }
}

/// `GET /api/v1/workers`: who renders, how fast, and what each has done.
pub async fn workers(Given(state): Given<State>) -> Json<Value> {
    let runner = state.runner();
    Json(json!({ "workers": runner.workers(), "units_outstanding": runner.outstanding() }))
}

/// `POST /api/v1/workers/{key}/trust`: a worker in quarantine or at rest gets units again. The body says nothing.
pub async fn trust(
    Given(state): Given<State>,
    Path(key): Path<String>,
    body: Body,
) -> Result<Json<Value>, Problem> {
    body::whole(&state, body, ("body_bytes", state.limits().body_bytes as u64)).await?;
    state
        .blocking(move |state| {
            if !state.runner().trust(&key)? {
                return Err(Problem::missing(format!("worker {key:?} in quarantine or at rest")));
            }
            log::warn!("worker {key}: trusted again, as was asked for");
            Ok(Json(json!({ "key": key })))
        })
        .await
}

/// `GET /metrics`, in Prometheus' text format.
pub async fn metrics(Given(state): Given<State>) -> Result<impl IntoResponse, Problem> {
    let (counts, oldest_ms, deliveries) = state
        .blocking(|state| {
            let ledger = state.ledger();
            Ok((ledger.counts()?, ledger.oldest_waiting()?, ledger.all_delivery_counts()?))
        })
        .await?;
    for (job, count) in counts {
        metrics::gauge!("raystream_jobs", "state" => job.name()).set(count as f64);
    }
    let DeliveryCounts { waiting, delivered, failed } = deliveries;
    for (kind, count) in [("waiting", waiting), ("delivered", delivered), ("failed", failed)] {
        metrics::gauge!("raystream_deliveries", "state" => kind).set(f64::from(count));
    }
    let age_ms = oldest_ms.map_or(0, |created_ms| (now_ms() - created_ms).max(0));
    metrics::gauge!("raystream_oldest_waiting_seconds").set(age_ms as f64 / 1000.0);
    let workers = state.runner().workers();
    for (kind, count) in ShownWorker::counts(&workers) {
        metrics::gauge!("raystream_workers", "state" => kind).set(count as f64);
    }
    metrics::gauge!("raystream_units_outstanding").set(state.runner().outstanding() as f64);
    if let Some(free) = free_bytes(state.store().data()) {
        metrics::gauge!("raystream_data_folder_free_bytes").set(free as f64);
    }
    let text = state.metrics().render();
    Ok(([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], text))
}

/// Bytes that are free where a folder lies.
#[cfg(target_os = "linux")]
fn free_bytes(folder: &std::path::Path) -> Option<u64> {
    let about = rustix::fs::statvfs(folder).ok()?;
    Some(about.f_bavail.saturating_mul(about.f_frsize))
}

/// Other systems are not asked.
#[cfg(not(target_os = "linux"))]
fn free_bytes(_: &std::path::Path) -> Option<u64> {
    None
}
