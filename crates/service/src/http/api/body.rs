//! Reads bodies within limits of bytes and time.

use crate::contract::Problem;
use crate::http::state::State;
use axum::body::{Body, BodyDataStream, Bytes};
use axum::http::{HeaderMap, StatusCode, header};
use futures_util::StreamExt;
use serde::de::DeserializeOwned;
use std::time::{Duration, Instant};

/// The fewest bytes a second of a long body, after its first minute.
const LEAST_RATE: u64 = 1024;

/// Bytes of a body that is refused that are read before the answer.
const DRAINED_BYTES: u64 = 64 << 20;

/// A body whose pieces come one after another.
pub struct Pieces {
    stream: BodyDataStream,
    pause: Duration,
    name: &'static str,
    limit: u64,
    began: Instant,
    total: u64,
}

impl Pieces {
    /// A body of at most so many bytes; the limit has a name.
    pub fn new(state: &State, body: Body, (name, limit): (&'static str, u64)) -> Self {
        let (stream, pause) = (body.into_data_stream(), state.limits().body_pause);
        Self { stream, pause, name, limit, began: Instant::now(), total: 0 }
    }

    /// The next piece; `None` at the end.
    ///
    /// # Errors
    /// 413 if there are more bytes than the limit; 408 if they come too slowly; 400 if the body ends early.
    pub async fn next(&mut self) -> Result<Option<Bytes>, Problem> {
        let slow = || Problem::new(StatusCode::REQUEST_TIMEOUT, "the body comes too slowly; send it again");
        let piece = tokio::time::timeout(self.pause, self.stream.next()).await.map_err(|_| slow())?;
        let Some(piece) = piece else { return Ok(None) };
        let piece = piece.map_err(|error| Problem::malformed(format!("the body ends early: {error}")))?;
        self.total += piece.len() as u64;
        if self.total > self.limit {
            return Err(self.refuse().await);
        }
        let seconds = self.began.elapsed().as_secs();
        if seconds > 60 && self.total / seconds < LEAST_RATE {
            return Err(slow());
        }
        Ok(Some(piece))
    }

    /// The refusal of a body that is too large. Some of the rest is read first, because clients that are still sending
    /// would not see it.
    pub async fn refuse(&mut self) -> Problem {
        self.drain(DRAINED_BYTES).await;
        too_large(self.name, self.limit)
    }

    /// Reads on to the end of the body, which is of no use any more, so that its client sees the answer.
    pub async fn end(&mut self) {
        self.drain(self.limit.saturating_sub(self.total)).await;
    }

    async fn drain(&mut self, mut left: u64) {
        while left > 0
            && let Ok(Some(Ok(piece))) = tokio::time::timeout(self.pause, self.stream.next()).await
        {
            left = left.saturating_sub(piece.len().max(1) as u64);
        }
    }
}

/// 413.
fn too_large(name: &str, limit: u64) -> Problem {
    let detail = format!("the body has more than {limit} bytes; make it smaller");
    Problem::limit(StatusCode::PAYLOAD_TOO_LARGE, name, limit, detail)
}

/// A whole body.
///
/// # Errors
/// As for [`Pieces::next`].
pub async fn whole(state: &State, body: Body, limit: (&'static str, u64)) -> Result<Vec<u8>, Problem> {
    let (mut pieces, mut bytes) = (Pieces::new(state, body, limit), Vec::new());
    while let Some(piece) = pieces.next().await? {
        bytes.extend_from_slice(&piece);
    }
    Ok(bytes)
}

/// The media type of a body, without parameters. Empty if it is not said.
pub fn media_type(headers: &HeaderMap) -> &str {
    let kind = headers.get(header::CONTENT_TYPE).and_then(|kind| kind.to_str().ok()).unwrap_or_default();
    kind.split(';').next().unwrap_or_default().trim()
}

/// A body of JSON.
///
/// # Errors
/// As for [`Pieces::next`]; 415 if it is said to be something else; 400 and 422 if it is not what is wanted.
pub async fn json<T: DeserializeOwned>(state: &State, headers: &HeaderMap, body: Body) -> Result<T, Problem> {
    if media_type(headers) != "application/json" {
        let detail = "send JSON, with `Content-Type: application/json`";
        return Err(Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, detail));
    }
    let limit = state.limits().body_bytes as u64;
    let bytes = whole(state, body, ("body_bytes", limit)).await?;
    serde_json::from_slice(&bytes).map_err(|error| match error.classify() {
        serde_json::error::Category::Data => Problem::unprocessable(error.to_string()),
        _ => Problem::malformed(format!("the body is not JSON: {error}")),
    })
}
