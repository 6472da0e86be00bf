//! A route: its handler, and its description in the OpenAPI document. Each is written once, in `routes.rs`.

use super::state::State;
use crate::coordinator::ledger::Role;
use axum::handler::Handler;
use axum::routing::{MethodRouter, delete, get, post, put};

/// JSON's media type.
pub const JSON: &str = "application/json";
/// The media type of any bytes.
pub const ANY: &str = "application/octet-stream";

/// A parameter of a query: its name, its JSON type, and true if it is required.
pub type Parameter = (&'static str, &'static str, bool);

/// The callers of a route.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Anyone.
    Open,
    /// Whoever shows a token of at least this role, or a cookie that was given for one.
    Role(Role),
    /// Those of [`Role::Submit`], and programs of this machine as well, if the service is open to them.
    Drake,
}

impl Access {
    /// The least role that is needed.
    pub fn role(self) -> Role {
        match self {
            Self::Open => Role::Read,
            Self::Role(role) => role,
            Self::Drake => Role::Submit,
        }
    }
}

/// The body of a request.
#[derive(Clone, Copy, Debug)]
pub enum Body {
    /// None.
    None,
    /// Any bytes.
    Bytes,
    /// JSON by the schema of this name.
    Json(&'static str),
    /// A form by the schema of this name.
    Form(&'static str),
}

/// A route.
pub struct Route {
    /// The method, in small letters.
    pub method: &'static str,
    /// The path, with names in braces.
    pub path: &'static str,
    /// One sentence.
    pub summary: &'static str,
    /// The handler of the method.
    pub handler: MethodRouter<State>,
    /// The callers.
    pub access: Access,
    /// Codes of success.
    pub codes: &'static [u16],
    /// Media types of an answer.
    pub media: &'static [&'static str],
    /// The schema of an answer in JSON.
    pub answer: Option<&'static str>,
    /// The body of a request.
    pub body: Body,
    /// Parameters of the query.
    pub query: &'static [Parameter],
}

impl Route {
    /// A route with the router of its method, for those who may submit; it answers 200 with JSON.
    pub fn new(
        method: &'static str,
        path: &'static str,
        summary: &'static str,
        handler: MethodRouter<State>,
    ) -> Self {
        let (access, codes, media) = (Access::Role(Role::Submit), &[200][..], &[JSON][..]);
        let (answer, body, query) = (None, Body::None, &[][..]);
        Self { method, path, summary, handler, access, codes, media, answer, body, query }
    }

    /// A route of GET, for those who may read.
    pub fn get<T: 'static>(path: &'static str, says: &'static str, handler: impl Handler<T, State>) -> Self {
        Self::new("get", path, says, get(handler)).access(Access::Role(Role::Read))
    }

    /// A route of POST.
    pub fn post<T: 'static>(path: &'static str, says: &'static str, handler: impl Handler<T, State>) -> Self {
        Self::new("post", path, says, post(handler))
    }

    /// A route of PUT.
    pub fn put<T: 'static>(path: &'static str, says: &'static str, handler: impl Handler<T, State>) -> Self {
        Self::new("put", path, says, put(handler))
    }

    /// A route of DELETE.
    pub fn delete<T: 'static>(
        path: &'static str,
        says: &'static str,
        handler: impl Handler<T, State>,
    ) -> Self {
        Self::new("delete", path, says, delete(handler))
    }

    /// Sets [`Self::access`].
    pub fn access(self, access: Access) -> Self {
        Self { access, ..self }
    }

    /// Sets [`Self::codes`].
    pub fn codes(self, codes: &'static [u16]) -> Self {
        Self { codes, ..self }
    }

    /// Sets [`Self::media`].
    pub fn media(self, media: &'static [&'static str]) -> Self {
        Self { media, ..self }
    }

    /// Sets [`Self::answer`].
    pub fn answer(self, schema: &'static str) -> Self {
        Self { answer: Some(schema), ..self }
    }

    /// Sets [`Self::body`].
    pub fn body(self, body: Body) -> Self {
        Self { body, ..self }
    }

    /// Sets [`Self::query`].
    pub fn query(self, query: &'static [Parameter]) -> Self {
        Self { query, ..self }
    }
}
