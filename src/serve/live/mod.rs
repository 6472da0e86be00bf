//! The live view.

use super::State;
use axum::Router;

/// Routes of the live view, behind the token.
pub fn router() -> Router<State> {
    Router::new()
}
