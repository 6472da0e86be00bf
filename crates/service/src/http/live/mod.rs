//! The address of live views.

mod socket;

use crate::contract::{LiveScene, Problem, is_sha256};
use crate::http::caller::Caller;
use crate::http::state::State;
use crate::live::{LiveLimits, LiveViews, TileWorkers, ViewScene};
use axum::extract::rejection::QueryRejection;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::extract::{Extension, Query, State as Given, WebSocketUpgrade};
use axum::response::Response;
use axum::routing::{MethodRouter, get};
use raystream::picture::RenderSpec;
use serde::Deserialize;
use std::sync::Arc;

/// The handler of live views.
pub fn handler() -> MethodRouter<State> {
    get(live).layer(Extension(Arc::new(LiveViews::new(LiveLimits::default()))))
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
    caller: Caller,
    Extension(views): Extension<Arc<LiveViews>>,
    query: Result<Query<Which>, QueryRejection>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Result<Response, Problem> {
    let Query(Which { scene }) = query.map_err(|error| Problem::malformed(error.body_text()))?;
    let upgrade = upgrade.map_err(|error| {
        Problem::malformed(format!("{}; this address is a WebSocket's", error.body_text()))
    })?;
    Ok(socket::limited(upgrade).on_upgrade(move |socket| async move {
        // A browser shows why only if it is told after the upgrade.
        // The place comes before the scene: whoever gets none has nothing read.
        let view_scene = match views.enter() {
            Err(error) => Err(error.to_string()),
            Ok(place) => {
                let (state, caller) = (state.clone(), caller.clone());
                let read = move || (view_scene(&state, &caller, scene), drop(place)).0;
                match tokio::task::spawn_blocking(read).await {
                    Ok(view_scene) => view_scene.map_err(|problem| problem.detail().to_owned()),
                    Err(_) => Err("the scene could not be read; see the log".to_owned()),
                }
            }
        };
        socket::run(socket, views, view_scene, (state, caller)).await;
    }))
}

/// Reads a scene, or finds it in the cache. The service's own scene is a tenant's of its own, which admins see.
fn view_scene(state: &State, caller: &Caller, scene: Option<String>) -> Result<ViewScene, Problem> {
    let scene = match scene {
        Some(scene) => Some(scene),
        None if caller.scope().is_none() && state.own_scene().is_some() => None,
        None => {
            let newest = state.ledger().jobs(&caller.filter(), None, 1)?;
            let nothing = || Problem::missing("scene to show yet; drop one on the page of jobs");
            Some(newest.into_iter().next().ok_or_else(nothing)?.scene)
        }
    };
    let (path, folder) = match (&scene, state.own_scene()) {
        (Some(sha256), _) => {
            // The name becomes a folder's.
            if !is_sha256(sha256) || caller.scene(state, sha256)?.is_none() {
                return Err(Problem::missing("such scene; upload it first"));
            }
            (state.store().entry(sha256, None)?, state.store().scene_folder(sha256))
        }
        (None, Some(own)) => (own.path().to_owned(), own.path().parent().unwrap_or(own.path()).to_owned()),
        (None, None) => return Err(Problem::missing("scene to show")),
    };
    let open_job = match &scene {
        // A process of its own reads what others have uploaded, within the limits of jobs.
        Some(_) => state.runner().read(&path, &folder),
        None => state.backend().open(&RenderSpec::default(), &path, &folder),
    };
    let open_job = open_job.map_err(Problem::unprocessable)?;
    let name = match &scene {
        Some(sha256) => sha256[..8].to_owned(),
        None => path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
    };
    let service = Arc::clone(state.backend().service());
    let view_scene = ViewScene::new(name.clone(), Arc::new(open_job.prepared().clone()), service)
        .with_times(open_job.timed());
    // As a job names it, or beside it on the disk.
    let mut spec = view_scene.spec.clone();
    spec.scene = Some(scene.clone().unwrap_or(name).into());
    let view_scene = view_scene.with_spec(spec);
    // Workers fetch it as an upload.
    let upload = match scene {
        Some(sha256) => Some((sha256, None)),
        None => state.own_scene().and_then(|own| own.upload().cloned()),
    };
    let tile_workers = upload.and_then(|(sha256, entry)| {
        let identity = open_job.identity(0).ok()?;
        let bus = Arc::clone(state.runner().bus()?);
        let workers = state.runner().tile_workers(&sha256);
        Some(TileWorkers::new(bus, LiveScene { sha256, entry, identity }, workers))
    });
    Ok(view_scene.with_viewer(state.backend().viewer()).with_workers(tile_workers))
}
