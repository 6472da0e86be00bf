//! A page shows the token once and gets a cookie.

use super::body;
use crate::contract::Problem;
use crate::http::auth::{COOKIE, refusal, set_cookie};
use crate::http::caller::Caller;
use crate::http::guard;
use crate::http::state::State;
use axum::Json;
use axum::body::Body;
use axum::extract::State as Given;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::{Value, json};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Login {
    token: String,
}

/// `GET /api/v1/session`.
pub async fn about(Given(state): Given<State>, caller: Caller) -> Result<Json<Value>, Problem> {
    let expires_ms = caller.token.as_ref().and_then(|token| token.expires_ms);
    let asking = caller.clone();
    let used = state.blocking(move |state| Ok(state.ledger().usage(asking.tenant())?)).await?;
    Ok(Json(json!({ "name": caller.name(), "tenant": caller.tenant(), "role": caller.role(),
        "expires_ms": expires_ms, "quotas": caller.quotas(), "used": used })))
}

/// `POST /api/v1/session`.
pub async fn create(Given(state): Given<State>, headers: HeaderMap, body: Body) -> Result<Response, Problem> {
    let Login { token } = body::json(&state, &headers, body).await?;
    let session = state.blocking(move |state| {
        let token = state.auth().of_token(&token).map_err(refusal)?;
        state.auth().session(&token).map_err(|error| {
            Problem::new(StatusCode::SERVICE_UNAVAILABLE, format!("there are no random numbers: {error}"))
        })
    });
    let cookie = set_cookie(&session.await?, state.is_secure());
    Ok((StatusCode::NO_CONTENT, [(header::SET_COOKIE, cookie)]).into_response())
}

/// `DELETE /api/v1/session`: the page forgets the cookie, and it lets no one in any more.
pub async fn remove(Given(state): Given<State>, headers: HeaderMap) -> Result<Response, Problem> {
    if let Some(session) = guard::session(&headers).map(str::to_owned) {
        state.blocking(move |state| Ok(state.auth().end_session(&session)?)).await?;
    }
    let cookie = format!("{COOKIE}=; Path=/; Max-Age=0; HttpOnly; SameSite=Strict");
    Ok((StatusCode::NO_CONTENT, [(header::SET_COOKIE, cookie)]).into_response())
}
