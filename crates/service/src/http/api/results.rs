//! Pictures and layers of finished frames.

use crate::contract::{self, Problem, hex};
use crate::coordinator::copies::FILES;
use crate::coordinator::ledger::FrameRow;
use crate::coordinator::storage::StorageError;
use crate::coordinator::store::Store;
use crate::http::caller::Caller;
use crate::http::state::State;
use axum::Json;
use axum::body::Body;
use axum::extract::{Path, Query, State as Given};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use raystream::film::{Exposure, Image, Look, Picture, View, write_picture};
use serde::Deserialize;
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::Read;
use std::sync::Arc;

/// The look of a PNG; without these, as the job asked. With `redirect`, where the file lies in the storage.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LookQuery {
    view: Option<String>,
    exposure: Option<String>,
    #[serde(default)]
    redirect: bool,
}

type LookResult = Result<Query<LookQuery>, axum::extract::rejection::QueryRejection>;

/// A file of a result, and what its content is a function of.
struct Found {
    store: Arc<Store>,
    job: String,
    row: FrameRow,
}

/// `GET /api/v1/jobs/{id}/frames/{frame}.{png,exr,npz,npy}`.
pub async fn picture(
    Given(state): Given<State>,
    caller: Caller,
    Path((id, file)): Path<(String, String)>,
    look: LookResult,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let Query(look) = look.map_err(|error| Problem::malformed(error.body_text()))?;
    let (frame, format) = file.rsplit_once('.').ok_or_else(|| no_picture(&file))?;
    let (frame, format) = (parse_frame(frame)?, format.to_owned());
    state
        .blocking(move |state| {
            let found = find(state, &caller, &id, frame)?;
            if look.redirect
                && let Some(response) = found.elsewhere(&format, &look)?
            {
                return Ok(response);
            }
            match &*format {
                "png" => shown(state, &found, &look, &headers),
                "exr" | "npz" => answer(&headers, &found.tag(&format), &format, || found.read(&format)),
                "npy" => array(&found, "image", &headers),
                _ => Err(no_picture(&file)),
            }
        })
        .await
}

/// `GET /api/v1/jobs/{id}/frames/{frame}/{layer}.npy`.
pub async fn layer(
    Given(state): Given<State>,
    caller: Caller,
    Path((id, frame, file)): Path<(String, String, String)>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let frame = parse_frame(&frame)?;
    let layer = file.strip_suffix(".npy").map(str::to_owned).ok_or_else(|| no_picture(&file))?;
    state.blocking(move |state| array(&find(state, &caller, &id, frame)?, &layer, &headers)).await
}

fn parse_frame(text: &str) -> Result<u32, Problem> {
    text.parse().map_err(|_| no_picture(text))
}

fn no_picture(file: &str) -> Problem {
    Problem::missing(format!("picture {file:?}; ask for FRAME.png, .exr, .npz, .npy or FRAME/LAYER.npy"))
}

/// A finished frame.
fn find(state: &State, caller: &Caller, id: &str, frame: u32) -> Result<Found, Problem> {
    let job = caller.job(state, id)?;
    let rows = state.ledger().frames(id)?;
    let row = rows.into_iter().find(|row| row.number == frame);
    if row.is_none() && job.is_planned {
        return Err(Problem::missing(format!("frame {frame} in job {id}")));
    }
    let row = row.filter(|row| row.hash.is_some()).ok_or_else(|| {
        let detail = format!("frame {frame} is not finished; the job is {}. Follow its events", job.state);
        Problem::new(StatusCode::CONFLICT, detail).with("state", job.state.name())
    })?;
    Ok(Found { store: Arc::clone(state.store()), job: id.to_owned(), row })
}

impl Found {
    /// Opens a file of the picture.
    fn open(&self, extension: &str) -> Result<File, Problem> {
        let file = self.store.picture(&self.job, &self.row, extension).map_err(|error| match error {
            StorageError::File(error) => self.gone(&error),
            StorageError::Missing(..) | StorageError::Damaged(..) => {
                log::error!("job {}: {error}", self.job);
                let detail = format!("{error}; submit the job again with `Cache-Control: no-cache`");
                Problem::new(StatusCode::BAD_GATEWAY, detail)
            }
            error => error.into(),
        })?;
        file.ok_or_else(|| {
            Problem::missing("file of this picture any more: it was removed; submit the job again")
        })
    }

    fn read(&self, extension: &str) -> Result<Vec<u8>, Problem> {
        let mut bytes = Vec::new();
        self.open(extension)?.read_to_end(&mut bytes).map_err(|error| self.gone(&error))?;
        Ok(bytes)
    }

    fn gone(&self, error: &dyn std::fmt::Display) -> Problem {
        log::error!("job {}, frame {}: {error}", self.job, self.row.number);
        let detail = "the picture's file cannot be read; submit the job again with `Cache-Control: no-cache`";
        Problem::new(StatusCode::INTERNAL_SERVER_ERROR, detail)
    }

    /// 307 to the file in the storage. `None` if it does not lie there, or is to be shown in another way.
    fn elsewhere(&self, extension: &str, look: &LookQuery) -> Result<Option<Response>, Problem> {
        let is_file = FILES.iter().any(|(own, _)| *own == extension);
        if !is_file || look.view.is_some() || look.exposure.is_some() {
            return Ok(None);
        }
        let Some((url, sum)) = self.store.picture_address(&self.job, &self.row, extension)? else {
            return Ok(None);
        };
        let headers = [(header::LOCATION, url.clone()), (header::CACHE_CONTROL, "no-store".into())];
        let body = json!({ "url": url, "bytes": sum.bytes, "sha256": sum.sha256 });
        Ok(Some((StatusCode::TEMPORARY_REDIRECT, headers, Json(body)).into_response()))
    }

    /// What changes when the bytes of a format do.
    fn tag(&self, of: &str) -> String {
        let FrameRow { hash, layers, metadata, .. } = &self.row;
        let all = format!("{hash:?} {layers:?} {metadata:?}");
        format!("\"{}-{of}\"", &hex(&Sha256::digest(all.as_bytes()))[..32])
    }

    /// A fact about the picture.
    fn fact(&self, name: &str) -> Option<String> {
        let facts: Map<String, Value> = serde_json::from_str(self.row.metadata.as_deref()?).ok()?;
        facts.get(name)?.as_str().map(str::to_owned)
    }

    /// The hash of the radiance or of a layer.
    fn hash(&self, layer: &str) -> Option<String> {
        if layer == "image" {
            return self.row.hash.clone();
        }
        let layers: Map<String, Value> = serde_json::from_str(self.row.layers.as_deref()?).ok()?;
        layers.get(layer)?.as_str().map(str::to_owned)
    }
}

/// 304 if the client has the bytes already.
fn answer(
    headers: &HeaderMap,
    tag: &str,
    format: &str,
    make: impl FnOnce() -> Result<Vec<u8>, Problem>,
) -> Result<Response, Problem> {
    let known = headers.get(header::IF_NONE_MATCH).and_then(|value| value.to_str().ok());
    let is_known = known.is_some_and(|known| {
        known.split(',').any(|one| matches!(one.trim(), "*") || one.trim().trim_start_matches("W/") == tag)
    });
    let kind = match format {
        "png" => "image/png",
        "exr" => "image/x-exr",
        "npz" => "application/zip",
        _ => "application/octet-stream",
    };
    let mut response = if is_known {
        StatusCode::NOT_MODIFIED.into_response()
    } else {
        ([(header::CONTENT_TYPE, kind)], Body::from(make()?)).into_response()
    };
    let cached = HeaderValue::from_static("private, no-cache");
    response.headers_mut().insert(header::CACHE_CONTROL, cached);
    if let Ok(tag) = HeaderValue::from_str(tag) {
        response.headers_mut().insert(header::ETAG, tag);
    }
    Ok(response)
}

/// An array of the picture's `.npz`.
fn array(found: &Found, name: &str, headers: &HeaderMap) -> Result<Response, Problem> {
    let missing = || Problem::missing(format!("layer {name:?}; the job's answer lists those that there are"));
    let hash = found.hash(name).ok_or_else(missing)?;
    answer(headers, &format!("\"{hash}-npy\""), "npy", || member(found, name)?.ok_or_else(missing))
}

/// A member of an `.npz`.
fn member(found: &Found, name: &str) -> Result<Option<Vec<u8>>, Problem> {
    let mut archive = zip::ZipArchive::new(found.open("npz")?).map_err(|error| found.gone(&error))?;
    let Ok(mut member) = archive.by_name(&npyz::npz::file_name_from_array_name(name)) else {
        return Ok(None);
    };
    let mut bytes = Vec::new();
    member.read_to_end(&mut bytes).map_err(|error| found.gone(&error))?;
    Ok(Some(bytes))
}

/// The picture as a display shows it.
fn shown(state: &State, found: &Found, look: &LookQuery, headers: &HeaderMap) -> Result<Response, Problem> {
    if look.view.is_none() && look.exposure.is_none() {
        return answer(headers, &found.tag("png"), "png", || found.read("png"));
    }
    let of_job = |name: &str| found.fact(name).unwrap_or_default();
    let name = look.view.clone().unwrap_or_else(|| of_job("view"));
    let view = View::ALL.into_iter().find(|view| view.name() == name).ok_or_else(|| {
        let names = View::ALL.map(View::name).join(", ");
        Problem::unprocessable(format!("view: {name:?} is none of {names}"))
    })?;
    let stops = look.exposure.clone().unwrap_or_else(|| of_job("exposure_stops"));
    let stops = stops.parse::<f32>().ok().filter(|stops| stops.abs() <= 126.0).ok_or_else(|| {
        Problem::unprocessable(format!("exposure: write a number of stops from -126 to 126, not {stops:?}"))
    })?;
    let white = of_job("white_balance").parse::<f32>().ok();
    let tag = found.tag(&format!("{}-{stops}-png", view.name()));
    answer(headers, &tag, "png", || {
        let base = Look::default().with_view(view).with_exposure(Exposure::Stops(stops));
        let look = white.map_or(base, |kelvin| base.with_white_balance(kelvin));
        let picture = radiance(found)?;
        let folder = tempfile::tempdir_in(state.store().temporary()).map_err(contract::refused)?;
        let path = folder.path().join("shown.png");
        let written = write_picture(&path, &picture, &look, &Default::default());
        written.map_err(|error| {
            Problem::new(StatusCode::SERVICE_UNAVAILABLE, format!("the picture cannot be encoded: {error}"))
        })?;
        std::fs::read(&path).map_err(|error| found.gone(&error))
    })
}

/// The shape of an array and its values.
type Values = (Vec<u64>, Vec<f32>);

/// Radiance and alpha of a finished frame.
fn radiance(found: &Found) -> Result<Picture, Problem> {
    let values = |name: &str| -> Result<Option<Values>, Problem> {
        let Some(bytes) = member(found, name)? else { return Ok(None) };
        let npy = npyz::NpyFile::new(&bytes[..]).map_err(|error| found.gone(&error))?;
        let shape = npy.shape().to_vec();
        let values = npy.into_vec::<f32>().map_err(|error| found.gone(&error))?;
        Ok(Some((shape, values)))
    };
    let (shape, image) = values("image")?.ok_or_else(|| found.gone(&"it has no image"))?;
    let &[height, width, 3] = &shape[..] else { return Err(found.gone(&"its image has another shape")) };
    let (pixels, _) = image.as_chunks::<3>();
    let mut picture = Picture::new(Image::new(width as u32, height as u32, pixels.to_vec()));
    picture.alpha = values("alpha")?.map(|(_, alpha)| alpha);
    Ok(picture)
}
