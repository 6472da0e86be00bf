//! The page in the browser.

use super::State;
use axum::Router;

/// Routes of the page's files, which need no token: they hold no data.
pub fn router() -> Router<State> {
    Router::new()
}
