//! What a refused request is answered: problem+json (RFC 9457).

use axum::http::StatusCode;
use serde_json::{Map, Value};

/// A refusal. It names what was wrong and what to do; a limit is named with its value.
#[derive(Clone, Debug)]
pub struct Problem {
    status: StatusCode,
    detail: String,
    more: Map<String, Value>,
    retry_after_s: Option<u64>,
}

impl Problem {
    /// A refusal with a status and a sentence.
    pub fn new(status: StatusCode, detail: impl Into<String>) -> Self {
        Self { status, detail: detail.into(), more: Map::new(), retry_after_s: None }
    }

    /// 422: the request is well-formed, but cannot be done.
    pub fn unprocessable(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, detail)
    }

    /// 400: the request is not well-formed.
    pub fn malformed(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, detail)
    }

    /// 404: there is no such thing.
    pub fn missing(what: impl std::fmt::Display) -> Self {
        Self::new(StatusCode::NOT_FOUND, format!("there is no {what}"))
    }

    /// A refusal because of a limit, with its name, its value and the remedy.
    pub fn limit(status: StatusCode, name: &str, limit: u64, detail: impl Into<String>) -> Self {
        Self::new(status, detail).with("limit", name).with("value", limit)
    }

    /// The same refusal with a member more.
    pub fn with(mut self, name: &str, value: impl Into<Value>) -> Self {
        self.more.insert(name.into(), value.into());
        self
    }

    /// The same refusal with the seconds after which the request may be sent again.
    pub fn retry_after(self, seconds: u64) -> Self {
        Self { retry_after_s: Some(seconds), ..self }
    }

    /// Seconds after which the request may be sent again, if that is known.
    pub fn retry_after_s(&self) -> Option<u64> {
        self.retry_after_s
    }

    /// The sentence.
    pub fn detail(&self) -> &str {
        &self.detail
    }

    /// Further members.
    pub fn more(self) -> Map<String, Value> {
        self.more
    }

    /// The status.
    pub fn status(&self) -> StatusCode {
        self.status
    }
}

impl std::fmt::Display for Problem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.detail)
    }
}

impl std::error::Error for Problem {}
