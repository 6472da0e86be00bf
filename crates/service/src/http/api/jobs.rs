//! Jobs: submitted, listed, steered.

use super::{body, scenes};
use crate::backend::JobCost;
use crate::contract::{Problem, hex};
use crate::coordinator::ledger::{
    Accepted, Checks, Deleted, FrameRow, Job, JobFilter, JobState, NewJob, Totals, now_ms,
};
use crate::coordinator::results::PICTURE;
use crate::coordinator::{JobRequest, parse_priority};
use crate::http::caller::{Caller, over_quota};
use crate::http::guard::RequestId;
use crate::http::state::State;
use crate::http::traces;
use axum::Json;
use axum::body::Body;
use axum::extract::{Extension, Path, Query, State as Given};
use axum::http::{HeaderMap, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use raystream::schedule::Priority;
use serde::Deserialize;
use serde_json::{Value, json};

/// Jobs of a list, unless a number is asked for, and at most.
const LISTED: usize = 50;
const MOST_LISTED: usize = 500;

/// The share of a job from which the time that is left is told.
const LEAST_PROGRESS: f64 = 0.01;

/// The most bytes of an idempotency key.
const MOST_KEY_BYTES: usize = 200;

/// `POST /api/v1/jobs`.
pub async fn submit(
    Given(state): Given<State>,
    caller: Caller,
    Extension(RequestId(request_id)): Extension<RequestId>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let request: JobRequest = body::json(&state, &headers, body).await?;
    let origin = Origin { request_id, trace_parent: traces::parent(&headers) };
    let key = idempotency_key(&headers)?;
    let fresh = headers.get(header::CACHE_CONTROL).is_some_and(|value| value == "no-cache");
    state.blocking(move |state| accept((state, &caller), (request, origin), key, fresh)).await
}

/// What a job comes from: the name of the request, and the span that it is a part of.
struct Origin {
    request_id: String,
    trace_parent: String,
}

fn idempotency_key(headers: &HeaderMap) -> Result<Option<String>, Problem> {
    let Some(key) = headers.get("idempotency-key") else { return Ok(None) };
    let text = key.to_str().ok().filter(|key| !key.is_empty() && key.len() <= MOST_KEY_BYTES);
    let wrong =
        || Problem::malformed(format!("an Idempotency-Key has 1 to {MOST_KEY_BYTES} ASCII characters"));
    text.map(|key| Some(key.to_owned())).ok_or_else(wrong)
}

/// Checks a request, and writes the name of its scene as the ledger has it. Returns its priority and its cost.
fn check(state: &State, caller: &Caller, request: &mut JobRequest) -> Result<(Priority, JobCost), Problem> {
    request.scene = scenes::sha256(&request.scene)
        .map_err(|_| Problem::unprocessable("scene: write the SHA-256 of the scene, 64 digits"))?;
    let known = caller.scene(state, &request.scene)?;
    known.ok_or_else(|| {
        Problem::unprocessable("scene: it has not been uploaded; PUT it to /api/v1/scenes/{sha256}")
    })?;
    request.check_words()?;
    let priority = request.priority()?;
    request.webhook.as_ref().map_or(Ok(()), |hook| check_address(state, &hook.url))?;
    let entry = state.store().entry(&request.scene, request.entry.as_deref())?;
    let folder = state.store().scene_folder(&request.scene);
    let demand = state.backend().check(&request.spec, &entry, &folder).map_err(Problem::unprocessable)?;
    check_demand(state, &demand)?;
    Ok((priority, demand))
}

/// Checks a request and writes it into the ledger.
fn accept(
    (state, caller): (&State, &Caller),
    (mut request, origin): (JobRequest, Origin),
    idempotency_key: Option<String>,
    is_fresh: bool,
) -> Result<Response, Problem> {
    let (priority, demand) = check(state, caller, &mut request)?;
    let request_hash = request.hash();
    let is_function = request.is_function(demand.kind);
    let may_share = is_function && !is_fresh && idempotency_key.is_none();
    let webhook = request.webhook.take();
    let mut shared_after = may_share.then_some(0);
    if may_share && let Some(job) = state.ledger().known(caller.tenant(), &request_hash)? {
        if has_pictures(state, &job.id)? {
            metrics::counter!("raystream_known_requests_total").increment(1);
            state.ledger().use_job(&job.id)?;
            if let Some(hook) = webhook
                && !state.ledger().add_delivery(&job.id, hook)?
            {
                return Err(too_many_calls(&job.id));
            }
            return answer(state, caller, &job.id, StatusCode::OK);
        }
        shared_after = Some(job.seq);
    }
    let id = new_id()?;
    let new = NewJob {
        id: id.clone(),
        tenant: caller.tenant().to_owned(),
        webhook,
        quotas: caller.quotas(),
        shared_after,
        request: serde_json::to_string(&request).expect("a request is JSON"),
        request_id: origin.request_id,
        trace_parent: origin.trace_parent,
        title: request.title.unwrap_or_default(),
        labels: request.labels,
        request_hash,
        demand,
        scene: request.scene,
        priority,
        idempotency_key,
    };
    let most = state.limits().open_jobs;
    match state.ledger().accept(new, most)? {
        Accepted::New => {
            state.runner().wake();
            answer(state, caller, &id, StatusCode::ACCEPTED)
        }
        Accepted::Shared(id) => {
            state.ledger().use_job(&id)?;
            metrics::counter!("raystream_known_requests_total").increment(1);
            hasten(state, caller, &id, priority)?;
            answer(state, caller, &id, StatusCode::OK)
        }
        Accepted::TooManyCalls(id) => Err(too_many_calls(&id)),
        Accepted::Earlier(id, true) => answer(state, caller, &id, StatusCode::OK),
        Accepted::Earlier(id, false) => Err(Problem::new(
            StatusCode::CONFLICT,
            format!("job {id} was submitted with this Idempotency-Key and another request; use another key"),
        )),
        Accepted::OverQuota(exceeded) => Err(over_quota(exceeded)),
        Accepted::TooMany(_) => {
            let detail = format!("{most} jobs have not ended; wait until some have, or cancel some");
            Err(Problem::limit(StatusCode::TOO_MANY_REQUESTS, "open_jobs", most, detail))
        }
    }
}

/// A name for a job.
fn new_id() -> Result<String, Problem> {
    let mut random = [0; 8];
    getrandom::fill(&mut random).map_err(|error| {
        Problem::new(StatusCode::SERVICE_UNAVAILABLE, format!("there are no random numbers: {error}"))
    })?;
    Ok(hex(&random))
}

/// The refusal of another call for a job.
fn too_many_calls(job: &str) -> Problem {
    let detail = format!("too many are to be called for job {job} already; wait until some have been");
    Problem::new(StatusCode::TOO_MANY_REQUESTS, detail).retry_after(10)
}

/// Makes a job that several requests share as urgent as the most urgent of them.
fn hasten(state: &State, caller: &Caller, id: &str, wanted: Priority) -> Result<(), Problem> {
    if wanted < caller.job(state, id)?.priority {
        state.ledger().set_priority(id, wanted)?;
        state.runner().set_priority(id, wanted);
    }
    Ok(())
}

/// Refuses what is no address that may be called. Where names lead is checked with each call.
fn check_address(state: &State, url: &str) -> Result<(), Problem> {
    let uri = url.parse::<Uri>().ok().filter(|uri| {
        let is_web = matches!(uri.scheme_str(), Some("http" | "https"));
        is_web && uri.host().is_some_and(|host| !host.is_empty())
    });
    let uri =
        uri.ok_or_else(|| Problem::unprocessable("webhook: the url is http:// or https:// with a host"))?;
    if state.reach().may_admit(&uri) {
        return Ok(());
    }
    Err(Problem::unprocessable(
        "webhook: the url has an address that is not public; name a public one, or ask whoever runs the service to \
         allow its network (--webhook-network)",
    ))
}

/// Whether the pictures of a done job are there: its folder may have been removed to make space.
fn has_pictures(state: &State, id: &str) -> Result<bool, Problem> {
    let folder = state.store().job_folder(id);
    let is_there = |frame: &FrameRow| {
        frame.objects.is_some()
            || folder.join(format!("frame-{}", frame.number)).join(PICTURE).with_extension("npz").is_file()
    };
    Ok(state.ledger().frames(id)?.iter().all(is_there))
}

/// Refuses what no job may ask for.
pub fn check_demand(state: &State, demand: &JobCost) -> Result<(), Problem> {
    let limits = state.limits();
    let over = |name: &str, limit: u64, asked: u64, remedy: &str| {
        let detail = format!("{name}: the request asks for {asked}, and the limit is {limit}; {remedy}");
        Problem::limit(StatusCode::UNPROCESSABLE_ENTITY, name, limit, detail)
    };
    if demand.pixels() > limits.pixels {
        return Err(over("pixels", limits.pixels, demand.pixels(), "make the picture smaller"));
    }
    let frames = demand.frames.unwrap_or(1);
    if frames > limits.frames {
        return Err(over("frames", limits.frames.into(), frames.into(), "split the job"));
    }
    if demand.samples() > limits.job_samples {
        let remedy = "take fewer samples or split the job";
        return Err(over("pixels × samples × frames", limits.job_samples, demand.samples(), remedy));
    }
    Ok(())
}

/// A job as answers show it.
fn shown(state: &State, job: &Job) -> Result<Value, Problem> {
    let (totals, checks) = (state.ledger().totals(&job.id)?, state.ledger().checks(&job.id)?);
    let (request, now) = (JobRequest::of(job), state.runner().share(&job.id));
    let Totals { units, units_done, share, .. } = totals;
    let Checks { compared, keys, suspects } = checks;
    let compared_share = compared as f64 / units_done.max(1) as f64;
    let progress = if job.state == JobState::Done { 1.0 } else { (share + now).min(1.0) };
    let title = request.as_ref().and_then(|request| request.title.clone());
    let labels = request.as_ref().map(|request| request.labels.clone()).unwrap_or_default();
    Ok(json!({
        "id": job.id, "tenant": job.tenant, "state": job.state, "priority": job.priority.name(), "scene": job.scene,
        "title": title, "labels": labels,
        "entry": request.as_ref().and_then(|request| request.entry.clone()),
        "spec": request.map(|request| request.spec),
        "size": [job.demand.size.0, job.demand.size.1], "spp": job.demand.spp, "kind": job.demand.kind,
        "created_ms": job.created_ms, "began_ms": job.began_ms, "ended_ms": job.ended_ms,
        "left_s": left_s(job, progress), "error": job.error, "progress": progress,
        "frames": totals.frames, "frames_done": totals.frames_done, "units": units, "units_done": units_done,
        "compared": { "units": compared, "share": compared_share.min(1.0), "workers": keys },
        "suspects": suspects, "pinned": job.is_pinned, "deliveries": state.ledger().delivery_counts(&job.id)?,
    }))
}

fn answer(state: &State, caller: &Caller, id: &str, status: StatusCode) -> Result<Response, Problem> {
    let job = caller.job(state, id)?;
    let body = Json(shown(state, &job)?);
    let location = format!("/api/v1/jobs/{id}");
    Ok((status, [(header::LOCATION, location)], body).into_response())
}

/// Seconds until a job that runs has ended, if it goes on as it has so far.
fn left_s(job: &Job, progress: f64) -> Option<u64> {
    let began_ms = job.began_ms.filter(|_| job.state == JobState::Running && progress >= LEAST_PROGRESS)?;
    let seconds = (now_ms() - began_ms).max(0) as f64 / 1000.0;
    Some((seconds * (1.0 - progress) / progress).ceil() as u64)
}

/// The query of a list of jobs: which, and the page.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ListQuery {
    state: Option<String>,
    text: Option<String>,
    label: Option<String>,
    since_ms: Option<i64>,
    until_ms: Option<i64>,
    cursor: Option<i64>,
    limit: Option<usize>,
}

/// `GET /api/v1/jobs`.
pub async fn list(
    Given(state): Given<State>,
    caller: Caller,
    query: Result<Query<ListQuery>, axum::extract::rejection::QueryRejection>,
) -> Result<Json<Value>, Problem> {
    let Query(ListQuery { state: wanted, text, label, since_ms, until_ms, cursor, limit }) =
        query.map_err(|error| Problem::malformed(error.body_text()))?;
    let wanted: Option<JobState> =
        wanted.map(|name| name.parse()).transpose().map_err(Problem::unprocessable)?;
    let filter = JobFilter { state: wanted, text, label, since_ms, until_ms, ..caller.filter() };
    let most = limit.unwrap_or(LISTED).clamp(1, MOST_LISTED);
    state
        .blocking(move |state| {
            let jobs = state.ledger().jobs(&filter, cursor, most)?;
            let next = (jobs.len() == most).then(|| jobs.last().map(|job| job.seq)).flatten();
            let jobs = jobs.iter().map(|job| shown(state, job)).collect::<Result<Vec<_>, _>>()?;
            Ok(Json(json!({ "jobs": jobs, "cursor": next })))
        })
        .await
}

/// `GET /api/v1/jobs/{id}`.
pub async fn status(
    Given(state): Given<State>,
    caller: Caller,
    Path(id): Path<String>,
) -> Result<Json<Value>, Problem> {
    state
        .blocking(move |state| {
            let job = caller.job(state, &id)?;
            let mut body = shown(state, &job)?;
            let frames: Vec<Value> = state.ledger().frames(&id)?.iter().map(shown_frame).collect();
            body["pictures"] = frames.into();
            Ok(Json(body))
        })
        .await
}

fn shown_frame(frame: &FrameRow) -> Value {
    let FrameRow { number, name, hash, layers, .. } = frame;
    let layers: Value =
        layers.as_deref().and_then(|text| serde_json::from_str(text).ok()).unwrap_or(json!({}));
    json!({ "frame": number, "name": name, "hash": hash, "layers": layers })
}

/// `GET /api/v1/jobs/{id}/deliveries`.
pub async fn deliveries(
    Given(state): Given<State>,
    caller: Caller,
    Path(id): Path<String>,
) -> Result<Json<Value>, Problem> {
    state
        .blocking(move |state| {
            caller.job(state, &id)?;
            Ok(Json(json!({ "deliveries": state.ledger().deliveries(&id)? })))
        })
        .await
}

const OPEN: &[JobState] = &[JobState::Queued, JobState::Running, JobState::Paused];
const ACTIVE: &[JobState] = &[JobState::Queued, JobState::Running];
const PAUSED: &[JobState] = &[JobState::Paused];
const LOST: &[JobState] = &[JobState::Failed, JobState::Cancelled];

/// Moves a job to another state; 409 if it is in none from which it can. The body says nothing, but it is read: the
/// connection would end otherwise.
async fn steer(
    (state, caller, id): (State, Caller, String),
    body: Body,
    from: &'static [JobState],
    to: JobState,
) -> Result<Json<Value>, Problem> {
    body::whole(&state, body, ("body_bytes", state.limits().body_bytes as u64)).await?;
    state
        .blocking(move |state| {
            caller.job(state, &id)?;
            let now = state.ledger().set_state(&id, from, to, None)?;
            let now = now.ok_or_else(|| Problem::missing(format!("job {id:?}")))?;
            // A second call of the same finds what the first did.
            let wanted =
                if to == JobState::Queued { now == to || now == JobState::Running } else { now == to };
            if !wanted {
                let detail = format!("the job is {now}, so it cannot become {to}");
                return Err(Problem::new(StatusCode::CONFLICT, detail).with("state", now.name()));
            }
            if to == JobState::Queued {
                state.ledger().forgive(&id)?;
            }
            match to {
                JobState::Queued => state.runner().wake(),
                _ => state.runner().stop_job(&id),
            }
            let totals = state.ledger().totals(&id)?;
            let pictures = state.ledger().frames(&id)?;
            let kept: Vec<u32> =
                pictures.iter().filter(|frame| frame.hash.is_some()).map(|frame| frame.number).collect();
            Ok(Json(json!({ "id": id, "state": now, "kept": {
                "frames": kept, "units": totals.units_done, "of_units": totals.units } })))
        })
        .await
}

/// `POST /api/v1/jobs/{id}/cancel`.
pub async fn cancel(
    Given(state): Given<State>,
    caller: Caller,
    Path(id): Path<String>,
    body: Body,
) -> Result<Json<Value>, Problem> {
    steer((state, caller, id), body, OPEN, JobState::Cancelled).await
}

/// `POST /api/v1/jobs/{id}/pause`.
pub async fn pause(
    Given(state): Given<State>,
    caller: Caller,
    Path(id): Path<String>,
    body: Body,
) -> Result<Json<Value>, Problem> {
    steer((state, caller, id), body, ACTIVE, JobState::Paused).await
}

/// `POST /api/v1/jobs/{id}/resume`.
pub async fn resume(
    Given(state): Given<State>,
    caller: Caller,
    Path(id): Path<String>,
    body: Body,
) -> Result<Json<Value>, Problem> {
    steer((state, caller, id), body, PAUSED, JobState::Queued).await
}

/// `POST /api/v1/jobs/{id}/retry`: a job that failed or was cancelled goes on from what is kept.
pub async fn retry(
    Given(state): Given<State>,
    caller: Caller,
    Path(id): Path<String>,
    body: Body,
) -> Result<Json<Value>, Problem> {
    steer((state, caller, id), body, LOST, JobState::Queued).await
}

/// `DELETE /api/v1/jobs/{id}`.
pub async fn delete(
    Given(state): Given<State>,
    caller: Caller,
    Path(id): Path<String>,
) -> Result<StatusCode, Problem> {
    state
        .blocking(move |state| {
            let subject = caller.job(state, &id)?.subject();
            let conflict = |detail: String| Problem::new(StatusCode::CONFLICT, detail);
            match state.runner().delete_job(&id)? {
                Deleted::Gone => {
                    log::info!("{subject}: deleted by {}", caller.name());
                    Ok(StatusCode::NO_CONTENT)
                }
                Deleted::Missing => Err(Problem::missing(format!("job {id:?}"))),
                Deleted::Pinned => Err(conflict("the job is pinned; unpin it first".into())),
                Deleted::Active(now) => {
                    let detail = format!("the job is {now}; cancel it, or wait until it has ended");
                    Err(conflict(detail).with("state", now.name()))
                }
            }
        })
        .await
}

/// `POST /api/v1/jobs/{id}/pin`: the job is kept until someone deletes it.
pub async fn pin(
    Given(state): Given<State>,
    caller: Caller,
    Path(id): Path<String>,
    body: Body,
) -> Result<Json<Value>, Problem> {
    set_pinned((state, caller, id), body, true).await
}

/// `POST /api/v1/jobs/{id}/unpin`.
pub async fn unpin(
    Given(state): Given<State>,
    caller: Caller,
    Path(id): Path<String>,
    body: Body,
) -> Result<Json<Value>, Problem> {
    set_pinned((state, caller, id), body, false).await
}

/// Pins a job, or lets it go. The body says nothing.
async fn set_pinned(
    (state, caller, id): (State, Caller, String),
    body: Body,
    is_pinned: bool,
) -> Result<Json<Value>, Problem> {
    body::whole(&state, body, ("body_bytes", state.limits().body_bytes as u64)).await?;
    state
        .blocking(move |state| {
            caller.job(state, &id)?;
            state.ledger().pin(&id, is_pinned)?;
            let job = caller.job(state, &id)?;
            Ok(Json(json!({ "id": id, "state": job.state, "pinned": job.is_pinned })))
        })
        .await
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NewPriority {
    priority: String,
}

/// `POST /api/v1/jobs/{id}/priority`.
pub async fn priority(
    Given(state): Given<State>,
    caller: Caller,
    Path(id): Path<String>,
    headers: HeaderMap,
    body: Body,
) -> Result<Json<Value>, Problem> {
    let NewPriority { priority } = body::json(&state, &headers, body).await?;
    let priority = parse_priority(&priority)?;
    state
        .blocking(move |state| {
            caller.job(state, &id)?;
            state.ledger().set_priority(&id, priority)?;
            state.runner().set_priority(&id, priority);
            let job = caller.job(state, &id)?;
            Ok(Json(json!({ "id": id, "state": job.state, "priority": priority.name() })))
        })
        .await
}
