//! Drake's render server: a glTF scene comes in with a form, and one picture goes out (the glTF Render Client-Server
//! API of Drake's documentation). Scenes are not kept.

mod answer;
mod form;

use crate::contract::Problem;
use crate::contract::refused;
use crate::coordinator::ledger::Charge;
use crate::coordinator::store::Passing;
use crate::http::api::jobs::check_demand;
use crate::http::caller::Caller;
use crate::http::state::State;
use answer::Wanted;
use axum::body::Body;
use axum::extract::rejection::QueryRejection;
use axum::extract::{Extension, Query, State as Given};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{MethodRouter, post};
use form::{Form, ImageType};
use raystream::picture::{RenderSpec, Watch};
use raystream::schedule::Priority;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use tokio::sync::{Semaphore, watch};

/// Pictures that are rendered at the same time. Others wait: a client of Drake's waits for its picture anyway.
const RENDERED: usize = 4;

/// Requests that are read, wait or are rendered at the same time.
const ACCEPTED: usize = 64;

/// Samples of a pixel of a colour image, unless the address says another number.
const SAMPLES: &str = "64";

/// The options of `raystream render` that the address may have, as in `/render?spp=256`.
const OPTIONS: [&str; 11] = [
    "clamp-indirect",
    "env",
    "env-rotation",
    "exposure",
    "filter",
    "integrator",
    "max-bounces",
    "seed",
    "spp",
    "view",
    "white-balance",
];

/// How many requests may be under way.
struct Bounds {
    accepted: Semaphore,
    rendered: Semaphore,
}

/// The handler of Drake's route.
pub fn handler() -> MethodRouter<State> {
    let bounds = Bounds { accepted: Semaphore::new(ACCEPTED), rendered: Semaphore::new(RENDERED) };
    post(render).layer(Extension(Arc::new(bounds)))
}

/// `POST /render`.
async fn render(
    Given(state): Given<State>,
    caller: Caller,
    Extension(bounds): Extension<Arc<Bounds>>,
    query: Result<Query<BTreeMap<String, String>>, QueryRejection>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let Query(options) = query.map_err(|error| Problem::malformed(error.body_text()))?;
    if let Some(name) = options.keys().find(|name| !OPTIONS.contains(&&***name)) {
        let detail = format!("{name:?} is no option of /render; it may have {}", OPTIONS.join(", "));
        return Err(Problem::unprocessable(detail));
    }
    let _accepted = bounds.accepted.try_acquire().map_err(|_| {
        let detail = format!("{ACCEPTED} requests are under way; wait for one of them");
        Problem::limit(StatusCode::TOO_MANY_REQUESTS, "renders", ACCEPTED as u64, detail)
    })?;
    let (form, upload) = form::read(&state, &headers, body).await?;
    let (asking, sent) = (caller.clone(), Charge::Bytes(upload.bytes()));
    let kept = state.blocking(move |state| {
        asking.charge(state, &[sent])?;
        state.store().pass(upload).map_err(refused)
    });
    let scene = kept.await?;
    form.check_hash(&scene)?;
    let wanted = Wanted::new(&form, &headers);
    let _rendered = bounds.rendered.acquire().await;
    // A client that leaves drops this future, and the picture is given up.
    let watched = Watched::default();
    let watch = watched.watch(&state);
    let bytes =
        state.blocking(move |state| draw((state, &caller), &form, options, &scene, &wanted, &watch)).await?;
    drop(watched);
    Ok(([(header::CONTENT_TYPE, bytes.0)], bytes.1).into_response())
}

/// Renders a picture. Returns its media type and its bytes.
fn draw(
    (state, caller): (&State, &Caller),
    form: &Form,
    options: BTreeMap<String, String>,
    scene: &Passing,
    wanted: &Wanted,
    watch: &dyn Watch,
) -> Result<(&'static str, Vec<u8>), Problem> {
    let _forgotten = Forgotten { state, scene };
    let (path, folder) = (scene.path(), scene.folder());
    let spec = RenderSpec::of(&options_of(form, options))
        .map_err(|error| Problem::unprocessable(error.to_string()))?;
    let demand = state.backend().check(&spec, path, folder).map_err(Problem::unprocessable)?;
    check_demand(state, &demand)?;
    caller.charge(state, &[Charge::Samples(demand.samples())])?;
    let open_job = state.runner().reader.open(&spec, path, folder).map_err(Problem::unprocessable)?;
    let mut frame = open_job.sum(0, None).map_err(Problem::unprocessable)?;
    while !frame.is_complete() {
        for (number, pass) in frame.passes() {
            let patch = open_job.patch(0, pass, watch);
            if watch.is_stopped() {
                return Err(Problem::new(
                    StatusCode::SERVICE_UNAVAILABLE,
                    "the service is ending; ask again",
                ));
            }
            let patch = patch.map_err(Problem::unprocessable)?;
            frame.add(number, &patch).map_err(|error| Problem::unprocessable(error.to_string()))?;
        }
    }
    wanted.encode(&frame.develop(), &open_job, folder)
}

/// The options of the picture's job.
fn options_of(form: &Form, given: BTreeMap<String, String>) -> Map<String, Value> {
    let Form { size: (width, height), focal, centre, .. } = form;
    // Drake counts pixel centres from 0.
    let [cx, cy] = centre.map(|pixels| pixels + 0.5);
    let mut options: Map<String, Value> = match form.image {
        ImageType::Colour => {
            let given = given.into_iter().map(|(name, value)| (name, Value::from(value)));
            std::iter::once(("spp".to_owned(), SAMPLES.into())).chain(given).collect()
        }
        // The layer of a pixel's centre needs no light.
        ImageType::Depth { .. } => layer("z"),
        ImageType::Label => layer("material"),
    };
    options.insert("size".into(), format!("{width}x{height}").into());
    options.insert("K".into(), format!("{},{},{cx},{cy}", focal[0], focal[1]).into());
    options
}

fn layer(name: &str) -> Map<String, Value> {
    let options = json!({ "spp": 1, "max-bounces": 0, "env": "0,0,0", "aov": name });
    options.as_object().cloned().unwrap_or_default()
}

/// Lets the cache forget a scene that no one can ask for again.
struct Forgotten<'a> {
    state: &'a State,
    scene: &'a Passing,
}

impl Drop for Forgotten<'_> {
    fn drop(&mut self) {
        self.state.backend().forget(self.scene.folder());
    }
}

/// A request that someone waits for.
#[derive(Default)]
struct Watched(Arc<AtomicBool>);

impl Watched {
    fn watch(&self, state: &State) -> RequestWatch {
        RequestWatch { is_over: Arc::clone(&self.0), ending: state.ending() }
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        self.0.store(true, Relaxed);
    }
}

/// Stops when no one waits any more, or the service ends.
struct RequestWatch {
    is_over: Arc<AtomicBool>,
    ending: watch::Receiver<bool>,
}

impl Watch for RequestWatch {
    fn priority(&self) -> Priority {
        Priority::Normal
    }

    fn is_stopped(&self) -> bool {
        self.is_over.load(Relaxed) || *self.ending.borrow()
    }

    fn traced(&self, rays: u64, _: f64) {
        metrics::counter!("raystream_rays_total").increment(rays);
    }

    fn progress(&self, _: f64) {}
}
