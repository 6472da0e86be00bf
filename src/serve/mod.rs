//! Jobs over HTTP: scenes come in, pictures go out, and what was accepted is done in spite of any crash.
//!
//! ```text
//! HTTP - guard (host, origin, token) - api -> ledger (SQLite) -> runner -> Pictures -> schedule::Service
//!                                       +--> store (scenes by hash)   +-- partial films, then results in files
//! ```
//!
//! The service knows neither options nor formats of scenes: [`Pictures`] checks and renders, and the command line
//! implements it, so that a job has the bytes of `raystream render`. `docs/guide/service.md` is the user's page.

mod api;
mod auth;
mod connections;
mod drake;
pub(crate) mod failpoint;
mod guard;
mod ledger;
mod limits;
pub mod live;
mod openapi;
mod own_scene;
pub mod page;
mod pictures;
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
pub use failpoint::Failpoint;
pub use limits::Limits;
pub use own_scene::{OwnScene, ScenePack};
pub use pictures::{Demand, Frame, Gathering, Kind, Pictures, Shots, Watch};
pub use problem::Problem;
pub(crate) use runner::decisions;
pub use runner::{FarmOptions, ShownWorker};
pub use scene_cache::SceneCache;
pub use scene_reader::SceneReader;
pub use server::{Options, ServeError, Stop, Tls, run};
pub use state::State;
pub use store::{entry_in, entry_name, inside, is_sha256};
