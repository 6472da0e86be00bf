//! Jobs over HTTP: scenes come in, pictures go out, and what was accepted is done in spite of any crash.
//!
//! ```text
//! HTTP - guard (host, origin, token) - api -> ledger (SQLite) -> runner -> RenderBackend -> picture
//!                                       +--> store (scenes by hash)   +-- partial films, then results in files
//! ```
//!
//! A job is a [`crate::picture::RenderSpec`] of an uploaded scene, so it has the bytes of `raystream render`.
//! `docs/guide/service.md` is the user's page.

mod api;
mod auth;
mod backend;
mod connections;
mod demand;
mod drake;
pub(crate) mod failpoint;
mod guard;
mod ledger;
mod limits;
pub mod live;
mod loaded_scenes;
mod open_job;
mod openapi;
mod own_scene;
mod pack;
pub mod page;
mod problem;
pub(crate) mod roots;
mod runner;
mod scene_cache;
mod scene_reader;
mod server;
mod state;
mod store;
mod trouble;
mod webhook;

pub(crate) use auth::write_private;
pub use auth::{TOKEN_FILE, hex};
pub use backend::{RenderBackend, SCHEDULED, SharedUnits};
pub use demand::{Demand, Frame, Kind};
pub use failpoint::Failpoint;
pub use limits::Limits;
pub use loaded_scenes::LoadedScenes;
pub use open_job::OpenJob;
pub use own_scene::{OwnScene, ScenePack};
pub use pack::Pack;
pub use problem::Problem;
pub(crate) use runner::decisions;
pub use runner::{FarmOptions, ShownWorker};
pub use scene_cache::SceneCache;
pub use scene_reader::SceneReader;
pub use server::{Options, ServeError, Stop, Tls, run};
pub use state::State;
pub use store::{entry_in, entry_name, inside, is_sha256};
