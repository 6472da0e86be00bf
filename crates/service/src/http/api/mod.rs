//! What requests are answered.

mod body;
mod events;
mod health;
mod jobs;
mod query;
mod results;
mod scenes;
mod session;
mod timeline;

pub use body::{Pieces, media_type};
pub(super) use jobs::check_demand;

use crate::contract::Problem;
use crate::http::state::State;
use crate::http::{drake, guard, live, openapi, page};
use axum::Router;
use axum::extract::Request;
use axum::http::StatusCode;
use axum::middleware::from_fn_with_state;
use axum::routing::{get, post};

/// All routes.
pub fn router(state: State) -> Router {
    let open = Router::new()
        .route("/healthz", get(health::healthz))
        .route("/readyz", get(health::readyz))
        .route("/openapi.json", get(openapi::document))
        .route("/api/v1/session", post(session::create).delete(session::remove))
        .merge(page::router());
    let guarded = Router::new()
        .route("/metrics", get(health::metrics))
        .route("/api/v1/scenes/{sha256}", get(scenes::about).put(scenes::upload))
        .route("/api/v1/jobs", get(jobs::list).post(jobs::submit))
        .route("/api/v1/jobs/{id}", get(jobs::status))
        .route("/api/v1/jobs/{id}/cancel", post(jobs::cancel))
        .route("/api/v1/jobs/{id}/pause", post(jobs::pause))
        .route("/api/v1/jobs/{id}/resume", post(jobs::resume))
        .route("/api/v1/jobs/{id}/retry", post(jobs::retry))
        .route("/api/v1/jobs/{id}/priority", post(jobs::priority))
        .route("/api/v1/jobs/{id}/events", get(events::of_job))
        .route("/api/v1/jobs/{id}/timeline", get(timeline::of_job))
        .route("/api/v1/jobs/{id}/frames/{file}", get(results::picture))
        .route("/api/v1/jobs/{id}/frames/{frame}/{file}", get(results::layer))
        .route("/api/v1/workers", get(health::workers))
        .route("/api/v1/workers/{key}/trust", post(health::trust))
        .route("/api/v1/events", get(events::of_all))
        .route("/api/v1/query", post(query::query))
        .merge(live::router())
        .layer(from_fn_with_state(state.clone(), guard::token));
    open.merge(guarded)
        .merge(drake::router(&state))
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
