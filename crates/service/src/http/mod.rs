//! The service's door: requests over HTTP, the page, live views, webhooks.

mod api;
mod auth;
mod caller;
mod connections;
mod drake;
mod guard;
mod journal;
mod live;
mod measurements;
mod openapi;
pub mod page;
mod problem;
mod reach;
pub mod roots;
mod route;
mod routes;
mod server;
mod state;
mod traces;
mod webhook;

pub use auth::{AuthError, TOKEN_FILE};
pub use caller::Caller;
pub use openapi::api;
pub use reach::Reach;
pub use server::{Options, ServeError, Stop, Tls, run};
pub use state::State;
