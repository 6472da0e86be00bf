//! Handlers of the API's routes.

mod body;
pub mod events;
pub mod health;
pub mod jobs;
pub mod query;
pub mod results;
pub mod scenes;
pub mod session;
pub mod timeline;

pub use body::{Pieces, media_type};
