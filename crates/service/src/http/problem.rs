//! A refusal as the body of a response: problem+json (RFC 9457).

use crate::contract::Problem;
use axum::Json;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde_json::json;

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let (status, retry_after_s) = (self.status(), self.retry_after_s());
        let title = status.canonical_reason().unwrap_or("refused");
        let mut body = json!({ "type": "about:blank", "title": title, "status": status.as_u16(),
            "detail": self.detail() });
        if let Some(body) = body.as_object_mut() {
            body.extend(self.more());
        }
        let mut response = (status, Json(body)).into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/problem+json"));
        if status == StatusCode::UNAUTHORIZED {
            headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer realm=\"raystream\""));
        }
        if matches!(status, StatusCode::TOO_MANY_REQUESTS | StatusCode::SERVICE_UNAVAILABLE) {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(retry_after_s.unwrap_or(5)));
        }
        response
    }
}
