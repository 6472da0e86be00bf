//! A page shows the token once and gets a cookie.

use super::body;
use crate::contract::Problem;
use crate::http::auth::COOKIE;
use crate::http::state::State;
use axum::body::Body;
use axum::extract::State as Given;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Login {
    token: String,
}

/// `POST /api/v1/session`.
pub async fn create(Given(state): Given<State>, headers: HeaderMap, body: Body) -> Result<Response, Problem> {
    let Login { token } = body::json(&state, &headers, body).await?;
    if !state.auth().is_token(&token) {
        metrics::counter!("raystream_refused_tokens_total").increment(1);
        let detail = "the token is wrong; it is in the file `token` of the data folder";
        return Err(Problem::new(StatusCode::UNAUTHORIZED, detail));
    }
    let cookie = state.auth().set_cookie(state.is_secure());
    Ok((StatusCode::NO_CONTENT, [(header::SET_COOKIE, cookie)]).into_response())
}

/// `DELETE /api/v1/session`.
pub async fn remove() -> Response {
    let cookie = format!("{COOKIE}=; Path=/; Max-Age=0; HttpOnly; SameSite=Strict");
    (StatusCode::NO_CONTENT, [(header::SET_COOKIE, cookie)]).into_response()
}
