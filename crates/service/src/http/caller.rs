//! Who asks: what the token or cookie of a request allows.

use super::state::State;
use crate::contract::Problem;
use crate::coordinator::ledger::{Role, Token};
use axum::extract::FromRequestParts;
use axum::http::StatusCode;
use axum::http::request::Parts;

/// Whoever has sent a request that was let in.
#[derive(Clone, Debug)]
pub struct Caller {
    /// The token; `None` for a program of this machine that needs none.
    pub token: Option<Token>,
}

impl Caller {
    /// The token's name.
    pub fn name(&self) -> &str {
        self.token.as_ref().map_or("none", |token| &token.name)
    }

    /// What the caller may do.
    pub fn role(&self) -> Role {
        self.token.as_ref().map_or(Role::Submit, |token| token.role)
    }

    /// Refuses whoever may not do what a role may.
    ///
    /// # Errors
    /// 403.
    pub fn check(&self, needed: Role) -> Result<(), Problem> {
        if self.role() >= needed {
            return Ok(());
        }
        let detail = format!("this needs a token of the role {needed}, and yours has {}", self.role());
        Err(Problem::new(StatusCode::FORBIDDEN, detail))
    }
}

impl FromRequestParts<State> for Caller {
    type Rejection = Problem;

    /// Takes what the guard has left. A route without a guard has no caller.
    async fn from_request_parts(parts: &mut Parts, _: &State) -> Result<Self, Problem> {
        let caller = parts.extensions.get().cloned();
        caller.ok_or_else(|| {
            Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "no one was asked for a token on this route")
        })
    }
}
