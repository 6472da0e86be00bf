//! Rays in, hits out.

use super::{body, scenes};
use crate::contract::Problem;
use crate::coordinator::JobRequest;
use crate::coordinator::ledger::Charge;
use crate::http::caller::Caller;
use crate::http::state::State;
use axum::body::Body;
use axum::extract::{Query, State as Given};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use raystream::numpy::{Array, Npz, Values};
use raystream::picture::RenderSpec;
use raystream::schedule::{JobOptions, Priority};
use raystream::stream::Ray;
use serde::Deserialize;
use std::fmt::Display;
use std::io::{self, Cursor};
use std::sync::Arc;

/// The scene that rays are asked of, and the kind of hit.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RayQuery {
    scene: String,
    entry: Option<String>,
    #[serde(default)]
    any_hit: bool,
}

/// The most bytes of the header of a `.npy` file.
const HEADER_BYTES: u64 = 4096;

/// `POST /api/v1/query`.
pub async fn query(
    Given(state): Given<State>,
    caller: Caller,
    query: Result<Query<RayQuery>, axum::extract::rejection::QueryRejection>,
    body: Body,
) -> Result<Response, Problem> {
    let Query(query) = query.map_err(|error| Problem::malformed(error.body_text()))?;
    let scene = scenes::sha256(&query.scene)?;
    let limit = state.limits().query_rays * size_of::<Ray>() as u64 + HEADER_BYTES;
    let bytes = body::whole(&state, body, ("query_rays", limit)).await?;
    state
        .blocking(move |state| {
            let known = caller.scene(state, &scene)?;
            known.ok_or_else(|| Problem::missing("such scene; upload it with PUT"))?;
            let rays = rays(&bytes).map_err(Problem::unprocessable)?;
            let charges = [Charge::Samples(rays.len() as u64), Charge::Bytes(bytes.len() as u64)];
            caller.charge(state, &charges)?;
            let request = JobRequest {
                scene,
                entry: query.entry,
                title: None,
                labels: vec![],
                spec: RenderSpec::default(),
                priority: None,
                webhook: None,
            };
            let hits = trace(state, &request, rays, query.any_hit)?;
            Ok(([(header::CONTENT_TYPE, "application/zip")], hits).into_response())
        })
        .await
}

/// The rays of a `.npy` file.
fn rays(bytes: &[u8]) -> Result<Arc<[Ray]>, String> {
    let wanted = |found: &dyn Display| {
        format!("the body is a .npy of float32 and shape (n, 8): origin, t_min, direction, t_max; {found}")
    };
    let npy = npyz::NpyFile::new(bytes).map_err(|error| wanted(&error))?;
    let shape = npy.shape().to_vec();
    let (&[count, 8], npyz::Order::C) = (&shape[..], npy.order()) else {
        return Err(wanted(&format!("its shape is {shape:?}")));
    };
    let values: Vec<f32> = npy.into_vec().map_err(|error| wanted(&error))?;
    let (rays, _) = values.as_chunks::<8>();
    if rays.len() as u64 != count {
        return Err(wanted(&format!("its shape has {count} rays, and its data {}", rays.len())));
    }
    Ok(rays.iter().map(|ray| bytemuck::cast(*ray)).collect())
}

/// The hits as `.npz`, as `raystream trace` writes them.
fn trace(state: &State, request: &JobRequest, rays: Arc<[Ray]>, any_hit: bool) -> Result<Vec<u8>, Problem> {
    let open_job = state.runner().open_scene(request).map_err(Problem::unprocessable)?;
    let failed = |error: &dyn Display| {
        Problem::new(StatusCode::INTERNAL_SERVER_ERROR, format!("tracing failed: {error}"))
    };
    let service = state.backend().service();
    let tracers = open_job.prepared().tracers.clone();
    let options = JobOptions::default().with_name("query").with_priority(Priority::Normal);
    let mut npz = Cursor::new(Vec::new());
    let written = if any_hit {
        let query = service.occluded(tracers, rays, options).map_err(|error| failed(&error))?;
        let (occluded, _) = query.wait().map_err(|error| failed(&error))?;
        write(&mut npz, &[("occluded", 0, Values::Bool(&occluded))])
    } else {
        let query = service.closest(tracers, rays, options).map_err(|error| failed(&error))?;
        let (hits, _) = query.wait().map_err(|error| failed(&error))?;
        let primitive: Vec<u32> = hits.iter().map(|hit| hit.primitive).collect();
        let t: Vec<f32> = hits.iter().map(|hit| hit.t).collect();
        let uv: Vec<f32> = hits.iter().flat_map(|hit| [hit.u, hit.v]).collect();
        let arrays = [
            ("primitive", 0, Values::U32(&primitive)),
            ("t", 0, Values::F32(&t)),
            ("uv", 2, Values::F32(&uv)),
        ];
        write(&mut npz, &arrays)
    };
    written.map_err(|error| failed(&error))?;
    Ok(npz.into_inner())
}

fn write(npz: &mut Cursor<Vec<u8>>, arrays: &[(&str, u64, Values<'_>)]) -> io::Result<()> {
    let mut file = Npz::new(npz);
    for &(name, columns, values) in arrays {
        let len = values.count() as u64;
        let shape = len.checked_div(columns).map_or(vec![len], |rows| vec![rows, columns]);
        file.array(name, &Array { shape, values })?;
    }
    file.finish()
}
