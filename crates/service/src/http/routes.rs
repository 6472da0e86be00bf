//! All routes: the router and the OpenAPI document are made from this list.

use super::api::{events, health, jobs, query, results, scenes, session, timeline};
use super::route::{ANY, Access, Body, Route};
use super::state::State;
use super::{drake, guard, live, openapi, page};
use crate::contract::Problem;
use crate::coordinator::ledger::Role;
use axum::Router;
use axum::extract::Request;
use axum::http::StatusCode;
use axum::middleware::from_fn_with_state;

const TEXT: &[&str] = &["text/plain"];
const EVENTS: &[&str] = &["text/event-stream"];
const PICTURES: &[&str] = &["image/png", "image/x-exr", "application/zip", ANY];

/// The routes, each with its handler and its description.
pub fn all() -> Vec<Route> {
    open().into_iter().chain(of_jobs()).chain(of_farms()).chain(of_scenes()).collect()
}

fn open() -> [Route; 5] {
    [
        Route::get("/healthz", "The process answers", health::healthz).media(TEXT),
        Route::get("/readyz", "The service can work", health::readyz).media(TEXT),
        Route::get("/openapi.json", "This document", openapi::document),
        Route::post("/api/v1/session", "Token in, cookie out", session::create)
            .codes(&[204])
            .body(Body::Json("Login")),
        Route::delete("/api/v1/session", "End the cookie", session::remove).codes(&[204]),
    ]
    .map(|route| route.access(Access::Open))
}

fn of_jobs() -> [Route; 16] {
    [
        Route::get("/api/v1/jobs", "Jobs, the latest first; `cursor` leads to the next page", jobs::list)
            .query(&[
                ("state", "state", false),
                ("text", "string", false),
                ("label", "string", false),
                ("since_ms", "integer", false),
                ("until_ms", "integer", false),
                ("cursor", "integer", false),
                ("limit", "integer", false),
            ]),
        Route::post(
            "/api/v1/jobs",
            "Submit a job: 202, or 200 if one with the same request has ended or is under way",
            jobs::submit,
        )
        .codes(&[200, 202])
        .body(Body::Json("JobRequest")),
        Route::get("/api/v1/jobs/{id}", "State, progress, pictures with their hashes", jobs::status)
            .answer("Job"),
        Route::delete("/api/v1/jobs/{id}", "Delete a job that has ended, with its pictures", jobs::delete)
            .codes(&[204]),
        Route::post("/api/v1/jobs/{id}/pin", "Keep a job until someone deletes it", jobs::pin)
            .answer("Steered"),
        Route::post("/api/v1/jobs/{id}/unpin", "Let a job be deleted again", jobs::unpin).answer("Steered"),
        Route::post("/api/v1/jobs/{id}/cancel", "Abandon a job", jobs::cancel).answer("Steered"),
        Route::post("/api/v1/jobs/{id}/pause", "Let a job wait", jobs::pause).answer("Steered"),
        Route::post("/api/v1/jobs/{id}/resume", "Go on with a paused job", jobs::resume).answer("Steered"),
        Route::post("/api/v1/jobs/{id}/retry", "Go on with a failed or cancelled job", jobs::retry)
            .answer("Steered"),
        Route::post("/api/v1/jobs/{id}/priority", "Change the priority", jobs::priority)
            .answer("Steered")
            .body(Body::Json("Priority")),
        Route::get(
            "/api/v1/jobs/{id}/events",
            "Server-sent events of a job; `Last-Event-ID` goes on after one",
            events::of_job,
        )
        .media(EVENTS),
        Route::get(
            "/api/v1/jobs/{id}/deliveries",
            "Who is called when a job has ended, and what became of the calls",
            jobs::deliveries,
        )
        .answer("Deliveries"),
        Route::get(
            "/api/v1/jobs/{id}/timeline",
            "Who rendered which unit when, as a Chrome trace",
            timeline::of_job,
        ),
        Route::get(
            "/api/v1/jobs/{id}/frames/{file}",
            "A picture: FRAME.png, .exr, .npz or .npy; 307 to the storage if `redirect` asks for it and there is one",
            results::picture,
        )
        .codes(&[200, 304, 307])
        .media(PICTURES)
        .query(&[("view", "string", false), ("exposure", "string", false), ("redirect", "boolean", false)]),
        Route::get(
            "/api/v1/jobs/{id}/frames/{frame}/{file}",
            "A layer of a frame: LAYER.npy",
            results::layer,
        )
        .codes(&[200, 304])
        .media(&[ANY]),
    ]
}

fn of_farms() -> [Route; 5] {
    let admin = Access::Role(Role::Admin);
    [
        Route::get(
            "/api/v1/session",
            "Who asks: the token's name, tenant, role, end, quotas and what is used of them",
            session::about,
        )
        .answer("Caller"),
        Route::get("/api/v1/workers", "Who renders, how fast, and what each has done", health::workers)
            .access(admin),
        Route::post("/api/v1/workers/{key}/trust", "Let a worker take units again", health::trust)
            .access(admin),
        Route::get("/api/v1/events", "Server-sent events of all your jobs", events::of_all).media(EVENTS),
        Route::get("/metrics", "Measurements for Prometheus", health::metrics)
            .media(TEXT)
            .access(Access::Role(Role::Metrics)),
    ]
}

fn of_scenes() -> [Route; 7] {
    [
        Route::get(
            "/api/v1/scenes/{sha256}",
            "A scene that you have uploaded; 404 if you have not",
            scenes::about,
        )
        .answer("Scene"),
        Route::put(
            "/api/v1/scenes/{sha256}",
            "Upload a GLB, or a zip of files: 201, or 200 if you have done so before",
            scenes::upload,
        )
        .codes(&[200, 201])
        .answer("Scene")
        .body(Body::Bytes),
        Route::post(
            "/api/v1/scenes/{sha256}/address",
            "An address in the storage to which a scene of this size is PUT",
            scenes::address,
        )
        .answer("UploadAddress")
        .body(Body::Json("Size")),
        Route::post(
            "/api/v1/scenes/{sha256}/take",
            "Take in a scene of this size that was PUT there: 201, or 200 if you have uploaded it before",
            scenes::take,
        )
        .codes(&[200, 201])
        .answer("Scene")
        .body(Body::Json("Size")),
        Route::post("/api/v1/query", "Rays in (.npy), hits out (.npz)", query::query)
            .media(&["application/zip"])
            .body(Body::Bytes)
            .query(&[("scene", "string", true), ("entry", "string", false), ("any_hit", "boolean", false)]),
        Route::new("get", "/api/v1/live", "A live view on a WebSocket", live::handler())
            .codes(&[101])
            .query(&[("scene", "string", false)]),
        Route::new("post", "/render", "A picture of Drake's glTF scene", drake::handler())
            .access(Access::Drake)
            .media(&["image/png", "image/tiff"])
            .body(Body::Form("RenderForm")),
    ]
}

/// The router of all routes, and of the page's files.
pub fn router(state: State) -> Router {
    let add = |router: Router<State>, route: Route| {
        let handler = match route.access {
            Access::Open => route.handler,
            access => route.handler.route_layer(from_fn_with_state((state.clone(), access), guard::admit)),
        };
        router.route(route.path, handler)
    };
    all()
        .into_iter()
        .fold(Router::new(), add)
        .merge(page::router())
        .fallback(no_such_route)
        .method_not_allowed_fallback(no_such_method)
        .layer(from_fn_with_state(state.clone(), guard::origin))
        .with_state(state)
}

async fn no_such_route(request: Request) -> Problem {
    Problem::missing(format!("{:?}; /openapi.json lists what there is", request.uri().path()))
}

async fn no_such_method(request: Request) -> Problem {
    let detail = format!("{} is not allowed here; /openapi.json lists what is", request.method());
    Problem::new(StatusCode::METHOD_NOT_ALLOWED, detail)
}
