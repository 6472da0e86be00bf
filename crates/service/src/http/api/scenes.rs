//! Uploads of scenes.

use super::body::{self, Pieces};
use crate::contract::{self, Problem};
use crate::coordinator::ledger::Charge;
use crate::coordinator::storage::SUM_HEADER;
use crate::coordinator::store::Upload;
use crate::http::caller::Caller;
use crate::http::state::State;
use axum::Json;
use axum::body::Body;
use axum::extract::{Path, State as Given};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::sync::SemaphorePermit;

/// The SHA-256 of an address.
///
/// # Errors
/// 404 if it is none.
pub fn sha256(text: &str) -> Result<String, Problem> {
    let is_hex = text.len() == 64 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    let sha256 = is_hex.then(|| text.to_ascii_lowercase());
    sha256.ok_or_else(|| Problem::missing("such scene; its address is the SHA-256 of its bytes, 64 digits"))
}

fn answer(sha256: &str, bytes: u64) -> Json<Value> {
    Json(json!({ "sha256": sha256, "bytes": bytes }))
}

/// `GET` and `HEAD /api/v1/scenes/{sha256}`.
pub async fn about(
    Given(state): Given<State>,
    caller: Caller,
    Path(name): Path<String>,
) -> Result<Json<Value>, Problem> {
    let sha256 = sha256(&name)?;
    let asked = sha256.clone();
    let bytes = state.blocking(move |state| caller.scene(state, &asked)).await?;
    Ok(answer(&sha256, bytes.ok_or_else(|| Problem::missing("such scene; upload it with PUT"))?))
}

/// `PUT /api/v1/scenes/{sha256}`.
pub async fn upload(
    Given(state): Given<State>,
    caller: Caller,
    Path(name): Path<String>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let sha256 = sha256(&name)?;
    // Bytes that another tenant has uploaded are read whole: who knows their hash alone does not get them.
    let (asked, asking) = (sha256.clone(), caller.clone());
    if let Some(bytes) = state.blocking(move |state| asking.scene(state, &asked)).await? {
        return Ok((StatusCode::OK, answer(&sha256, bytes)).into_response());
    }
    let limit = state.limits().scene_bytes;
    let length: Option<u64> =
        headers.get(header::CONTENT_LENGTH).and_then(|length| length.to_str().ok()?.parse().ok());
    let mut pieces = Pieces::new(&state, body, ("scene_bytes", limit));
    if length.is_some_and(|length| length > limit) {
        return Err(pieces.refuse().await);
    }
    let _permit = permit(&state)?;
    if let Some(length) = length {
        let asking = caller.clone();
        let charged = state.blocking(move |state| asking.charge(state, &[Charge::Bytes(length)])).await;
        if let Err(problem) = charged {
            pieces.refuse().await;
            return Err(problem);
        }
    }
    let upload = receive(&state, &mut pieces).await?;
    let kept = sha256.clone();
    let bytes = state
        .blocking(move |state| {
            if length.is_none() {
                caller.charge(state, &[Charge::Bytes(upload.bytes())])?;
            }
            state.store().keep(upload, &kept, state.limits(), |bytes| {
                state.ledger().keep_scene(Some(caller.tenant()), &kept, bytes)
            })
        })
        .await?;
    metrics::counter!("raystream_uploaded_bytes_total").increment(bytes);
    Ok((StatusCode::CREATED, answer(&sha256, bytes)).into_response())
}

/// The right to upload, for as long as it is held.
fn permit(state: &State) -> Result<SemaphorePermit<'_>, Problem> {
    let most = state.limits().uploads as u64;
    state.uploads().try_acquire().map_err(|_| {
        let detail = format!("{most} uploads are under way; wait for one of them");
        Problem::limit(StatusCode::TOO_MANY_REQUESTS, "uploads", most, detail)
    })
}

/// The size of a scene in the storage.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Size {
    bytes: u64,
}

/// Reads the size, which is within the limit.
async fn size(state: &State, headers: &HeaderMap, body: Body) -> Result<u64, Problem> {
    let Size { bytes } = body::json(state, headers, body).await?;
    let limit = state.limits().scene_bytes;
    if bytes > limit {
        let detail = format!("the scene has {bytes} bytes, and the limit is {limit}; make it smaller");
        return Err(Problem::limit(StatusCode::PAYLOAD_TOO_LARGE, "scene_bytes", limit, detail));
    }
    if bytes == 0 { Err(Problem::unprocessable("bytes: a scene has at least one")) } else { Ok(bytes) }
}

fn no_storage() -> Problem {
    Problem::missing("storage of this service; PUT the scene to /api/v1/scenes/{sha256}")
}

/// `POST /api/v1/scenes/{sha256}/address`.
pub async fn address(
    Given(state): Given<State>,
    caller: Caller,
    Path(name): Path<String>,
    headers: HeaderMap,
    body: Body,
) -> Result<Json<Value>, Problem> {
    let bytes = size(&state, &headers, body).await?;
    let sha256 = sha256(&name)?;
    state
        .blocking(move |state| {
            let storage = state.store().storage().ok_or_else(no_storage)?;
            let address = state.store().upload_address(caller.tenant(), &sha256, bytes)?;
            let (url, sum) = address.ok_or_else(no_storage)?;
            let (expires_s, headers) = (storage.options().expiry.as_secs(), json!({ SUM_HEADER: sum }));
            Ok(Json(json!({ "method": "PUT", "url": url, "headers": headers, "expires_s": expires_s })))
        })
        .await
}

/// `POST /api/v1/scenes/{sha256}/take`.
pub async fn take(
    Given(state): Given<State>,
    caller: Caller,
    Path(name): Path<String>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let bytes = size(&state, &headers, body).await?;
    let sha256 = sha256(&name)?;
    let _permit = permit(&state)?;
    let (status, bytes, sha256) = state
        .blocking(move |state| {
            let store = state.store();
            store.storage().ok_or_else(no_storage)?;
            if let Some(bytes) = caller.scene(state, &sha256)? {
                return Ok((StatusCode::OK, bytes, sha256));
            }
            let tenant = caller.tenant();
            if !store.has_written(tenant, &sha256, bytes)? {
                let detail = format!(
                    "no {bytes} bytes were written to the address of this scene; PUT them there first"
                );
                return Err(Problem::new(StatusCode::CONFLICT, detail));
            }
            caller.charge(state, &[Charge::Bytes(bytes)])?;
            let kept = store.written(tenant, &sha256, bytes)?;
            let kept = store.keep(kept, &sha256, state.limits(), |bytes| {
                state.ledger().keep_scene(Some(tenant), &sha256, bytes)
            });
            // What was refused is refused again.
            if kept.as_ref().map_or_else(|problem| problem.status().is_client_error(), |_| true) {
                store.forget_written(tenant, &sha256, bytes);
            }
            Ok((StatusCode::CREATED, kept?, sha256))
        })
        .await?;
    metrics::counter!("raystream_uploaded_bytes_total").increment(bytes);
    Ok((status, answer(&sha256, bytes)).into_response())
}

/// Writes the pieces of an upload to the disk as they come.
async fn receive(state: &State, pieces: &mut Pieces) -> Result<Upload, Problem> {
    let refused = |state: &State, error: std::io::Error| {
        state.runner().trouble.note(&format!("the data folder cannot be written: {error}"));
        contract::refused(error)
    };
    let begun =
        state.blocking(move |state| state.store().begin().map_err(|error| refused(state, error))).await;
    let mut upload = match begun {
        Ok(upload) => upload,
        Err(problem) => {
            pieces.end().await;
            return Err(problem);
        }
    };
    while let Some(piece) = pieces.next().await? {
        let written = state.blocking(move |state| {
            upload.write(&piece).map_err(|error| refused(state, error))?;
            Ok(upload)
        });
        upload = match written.await {
            Ok(upload) => upload,
            Err(problem) => {
                // What is still sent has no place, and its sender is to be told.
                pieces.end().await;
                return Err(problem);
            }
        };
    }
    Ok(upload)
}
