//! The address of live views.

use super::{LiveLimits, LiveViews, Stage, socket};
use crate::farm::LiveScene;
use crate::picture::RenderSpec;
use crate::serve::{Problem, State};
use axum::Router;
use axum::extract::rejection::QueryRejection;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::{Extension, Query, State as Given, WebSocketUpgrade};
use axum::response::Response;
use axum::routing::get;
use serde::Deserialize;
use std::sync::Arc;

/// Routes of the live view, behind the token.
pub fn router() -> Router<State> {
    let views = Arc::new(LiveViews::new(LiveLimits::default()));
    Router::new().route("/api/v1/live", get(live)).layer(Extension(views))
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Which {
    /// SHA-256 of the scene; without it the service's own scene, or that of the newest job.
    scene: Option<String>,
}

/// `GET /api/v1/live`, upgraded to a WebSocket. Host, origin and token have been checked.
async fn live(
    Given(state): Given<State>,
    Extension(views): Extension<Arc<LiveViews>>,
    query: Result<Query<Which>, QueryRejection>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Result<Response, Problem> {
    let Query(Which { scene }) = query.map_err(|error| Problem::malformed(error.body_text()))?;
    let upgrade = upgrade.map_err(|error| {
        Problem::malformed(format!("{}; this address is a WebSocket's", error.body_text()))
    })?;
    let ending = state.ending();
    Ok(socket::limited(upgrade).on_upgrade(move |socket| async move {
        // A browser shows why only if it is told after the upgrade.
        // The place comes before the scene: whoever gets none has nothing read.
        let stage = match views.enter() {
            Err(error) => Err(error.to_string()),
            Ok(place) => {
                match tokio::task::spawn_blocking(move || (stage(&state, scene), drop(place)).0).await {
                    Ok(stage) => stage.map_err(|problem| problem.detail().to_owned()),
                    Err(_) => Err("the scene could not be read; see the log".to_owned()),
                }
            }
        };
        socket::run(socket, views, stage, ending).await;
    }))
}

/// Reads a scene, or finds it in the cache.
fn stage(state: &State, scene: Option<String>) -> Result<Stage, Problem> {
    let scene = match scene {
        Some(scene) => Some(scene),
        None if state.own_scene().is_some() => None,
        None => {
            let newest = state.ledger().jobs(None, None, 1)?;
            let nothing = || Problem::missing("scene to show yet; drop one on the page of jobs");
            Some(newest.into_iter().next().ok_or_else(nothing)?.scene)
        }
    };
    let (path, folder) = match (&scene, state.own_scene()) {
        (Some(sha256), _) => {
            // The name becomes a folder's.
            let is_hash = sha256.len() == 64 && sha256.bytes().all(|byte| byte.is_ascii_hexdigit());
            if !is_hash || state.ledger().scene(sha256)?.is_none() {
                return Err(Problem::missing("such scene; upload it first"));
            }
            (state.store().entry(sha256, None)?, state.store().scene_folder(sha256))
        }
        (None, Some(own)) => (own.path().to_owned(), own.path().parent().unwrap_or(own.path()).to_owned()),
        (None, None) => return Err(Problem::missing("scene to show")),
    };
    let shots = match &scene {
        // A process of its own reads what others have uploaded, within the limits of jobs.
        Some(_) => state.runner().read(&path, &folder),
        None => state.backend().open(&RenderSpec::default(), &path, &folder),
    };
    let shots = shots.map_err(Problem::unprocessable)?;
    let name = match &scene {
        Some(sha256) => sha256[..8].to_owned(),
        None => path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
    };
    let service = Arc::clone(state.backend().service());
    let stage = Stage::new(name, Arc::new(shots.prepared().clone()), service);
    // Workers fetch it as an upload.
    let upload = match scene {
        Some(sha256) => Some((sha256, None)),
        None => state.own_scene().and_then(|own| own.upload().cloned()),
    };
    let workforce = upload.and_then(|(sha256, entry)| {
        let identity = shots.identity(0).ok()?;
        state.runner().workforce(LiveScene { sha256, entry, identity })
    });
    Ok(stage.with_viewer(state.backend().viewer()).with_workers(workforce))
}
