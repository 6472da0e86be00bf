//! What each request passes first: the host and origin that it names, and the token or cookie that it shows.

use super::auth::{COOKIE, Refused, refusal, unauthorised};
use super::caller::Caller;
use super::route::Access;
use super::state::State;
use crate::contract::{Problem, random_hex};
use axum::extract::{ConnectInfo, MatchedPath, Request, State as Given};
use axum::http::uri::Authority;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, Uri, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use std::net::{IpAddr, SocketAddr};
use std::time::Instant;

/// Headers of every answer.
const HEADERS: [(&str, &str); 5] = [
    ("x-content-type-options", "nosniff"),
    ("referrer-policy", "no-referrer"),
    ("x-frame-options", "DENY"),
    ("cross-origin-resource-policy", "same-origin"),
    ("content-security-policy", "default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'"),
];

/// Refuses requests that a foreign page or a foreign name leads here, and counts all.
pub async fn origin(Given(state): Given<State>, mut request: Request, next: Next) -> Response {
    let (began, method) = (Instant::now(), request.method().clone());
    let path = request.uri().path().chars().take(MOST_PATH).collect();
    let asked = Asked { id: request_id(request.headers()), peer: peer(&request), path };
    request.extensions_mut().insert(RequestId(asked.id.clone()));
    let route = request.extensions().get::<MatchedPath>().map_or("none", MatchedPath::as_str).to_owned();
    let mut response = match check_names(&state, request.uri(), request.headers()) {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    };
    for (name, value) in HEADERS {
        let name = HeaderName::from_static(name);
        response.headers_mut().entry(name).or_insert(HeaderValue::from_static(value));
    }
    if let Ok(id) = HeaderValue::from_str(&asked.id) {
        response.headers_mut().insert(HeaderName::from_static(REQUEST_ID), id);
    }
    if response.status().is_server_error() {
        log::warn!("request {}: {method} {}: {}", asked.id, asked.path, response.status());
    }
    if is_audited(&method, &route, response.status()) {
        let (state, line) = (state.clone(), asked.line(&method, &response));
        if response.status().is_success() {
            let made = line["job"].as_str().map_or_else(String::new, |job| format!(", job {job}"));
            log::info!("request {}: {method} {}: {}{made}", asked.id, asked.path, response.status());
        }
        // The answer does not wait for the disk.
        tokio::task::spawn_blocking(move || state.audit().note("request", line));
    }
    let code = response.status().as_u16().to_string();
    let labels = [("route", route), ("method", method.to_string()), ("code", code)];
    metrics::histogram!("raystream_http_request_seconds", &labels).record(began.elapsed().as_secs_f64());
    response
}

/// The header with the name of a request: the client's own, or one that is drawn.
const REQUEST_ID: &str = "x-request-id";

/// The name of a request, as handlers find it.
#[derive(Clone, Debug)]
pub struct RequestId(pub String);

/// Characters of a path that are written down.
const MOST_PATH: usize = 200;

/// The longest name that a client may give its request.
const MOST_ID_BYTES: usize = 64;

/// A request, as it is remembered while it is answered.
struct Asked {
    id: String,
    peer: Option<SocketAddr>,
    path: String,
}

impl Asked {
    /// The line of the audit log for a request.
    fn line(&self, method: &Method, response: &Response) -> Value {
        let caller = response.extensions().get::<Caller>();
        let made = response.headers().get(header::LOCATION).and_then(|value| value.to_str().ok());
        json!({ "request": self.id, "from": self.peer.map(|peer| peer.ip()), "token": caller.map(Caller::name),
            "tenant": caller.map(Caller::tenant), "method": method.as_str(), "path": self.path,
            "status": response.status().as_u16(), "job": made.and_then(|made| made.strip_prefix("/api/v1/jobs/")) })
    }
}

/// Routes that only answer, though their questions have bodies.
const QUESTIONS: [&str; 2] = ["/api/v1/query", "/render"];

/// True for what changes something, and for refusals of who asks or of how much.
fn is_audited(method: &Method, route: &str, status: StatusCode) -> bool {
    const REFUSALS: [StatusCode; 3] =
        [StatusCode::UNAUTHORIZED, StatusCode::FORBIDDEN, StatusCode::TOO_MANY_REQUESTS];
    let changes = !matches!(*method, Method::GET | Method::HEAD) && !QUESTIONS.contains(&route);
    changes || REFUSALS.contains(&status)
}

/// The name of a request.
fn request_id(headers: &HeaderMap) -> String {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_' | b'.');
    let given = headers.get(REQUEST_ID).and_then(|value| value.to_str().ok());
    let given = given.filter(|id| (1..=MOST_ID_BYTES).contains(&id.len()) && id.bytes().all(is_plain));
    let drawn = || random_hex().map_or_else(|_| "none".into(), |text| text[..16].to_owned());
    given.map_or_else(drawn, str::to_owned)
}

/// The means by which a request is let in.
enum Shown {
    Token(String),
    Cookie(String),
    /// Nothing, which is enough for programs of this machine on some routes.
    Nothing,
}

/// Lets in who shows what a route needs, and refuses others. Handlers find the [`Caller`].
pub async fn admit(
    Given((state, access)): Given<(State, Access)>,
    mut request: Request,
    next: Next,
) -> Response {
    let checked = match shown(&state, access, &request) {
        Ok(shown) => state.blocking(move |state| caller(state, shown)).await,
        Err(problem) => Err(problem),
    };
    let caller = match checked {
        Ok(caller) => caller,
        Err(problem) => return problem.into_response(),
    };
    let mut response = match caller.check(access.role()) {
        Ok(()) => {
            peer(&request).into_iter().for_each(|peer| state.connections().trust(peer));
            request.extensions_mut().insert(caller.clone());
            next.run(request).await
        }
        Err(problem) => problem.into_response(),
    };
    // For the audit log.
    response.extensions_mut().insert(caller);
    response
}

/// The caller of what was shown.
fn caller(state: &State, shown: Shown) -> Result<Caller, Problem> {
    let token = match shown {
        Shown::Token(text) => state.auth().of_token(&text),
        Shown::Cookie(session) => state.auth().of_session(&session),
        Shown::Nothing => return Ok(Caller { token: None }),
    };
    Ok(Caller { token: Some(token.map_err(refusal)?) })
}

/// The other end of the connection.
fn peer(request: &Request) -> Option<SocketAddr> {
    request.extensions().get::<ConnectInfo<SocketAddr>>().map(|peer| peer.0)
}

/// Headers by which proxies say that a request comes from elsewhere.
const FORWARDED: [&str; 3] = ["forwarded", "x-forwarded-for", "via"];

/// Finds what a request shows. Addresses of Drake's clients may hold the token, as in `http://drake:TOKEN@HOST`, and
/// where the service is started so, programs of this machine need none.
fn shown(state: &State, access: Access, request: &Request) -> Result<Shown, Problem> {
    let headers = request.headers();
    if let Some(given) = text(headers, header::AUTHORIZATION) {
        let bearer = given.strip_prefix("Bearer ").map(str::to_owned);
        let basic = || match access {
            Access::Drake => password(given.strip_prefix("Basic ")?),
            _ => None,
        };
        let token = bearer.or_else(basic).ok_or_else(|| refusal(Refused::Unknown))?;
        return Ok(Shown::Token(token));
    }
    let is_local = peer(request).is_some_and(|peer| peer.ip().is_loopback())
        && !FORWARDED.iter().any(|name| headers.contains_key(*name));
    if access == Access::Drake && is_local && state.is_open_to_drake() {
        return Ok(Shown::Nothing);
    }
    let session = session(headers).ok_or_else(|| unauthorised("there is no token"))?;
    // The origin has been compared; programs use the header.
    let changes = !matches!(*request.method(), Method::GET | Method::HEAD);
    if changes && text(headers, header::ORIGIN).is_none() {
        return Err(Problem::new(
            StatusCode::FORBIDDEN,
            "a cookie changes nothing without an Origin header; programs send `Authorization: Bearer TOKEN`",
        ));
    }
    Ok(Shown::Cookie(session.to_owned()))
}

/// The value of the service's cookie.
pub fn session(headers: &HeaderMap) -> Option<&str> {
    let cookies = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
    cookies
        .flat_map(|cookies| cookies.split(';'))
        .find_map(|cookie| cookie.trim().strip_prefix(COOKIE)?.strip_prefix('='))
}

/// The password of HTTP's basic authentication (RFC 7617).
fn password(encoded: &str) -> Option<String> {
    let text = String::from_utf8(STANDARD.decode(encoded.trim()).ok()?).ok()?;
    text.split_once(':').map(|(_, password)| password.to_owned())
}

fn text(headers: &HeaderMap, name: HeaderName) -> Option<&str> {
    headers.get(name).and_then(|value| value.to_str().ok())
}

/// Compares host and origin. A name that resolves to this machine is no permission: pages of others can have one.
fn check_names(state: &State, uri: &Uri, headers: &HeaderMap) -> Result<(), Problem> {
    let host = host(uri, headers)?;
    let name = host_name(host);
    let is_known = name == "localhost"
        || name.trim_matches(['[', ']']).parse::<IpAddr>().is_ok()
        || state.host_names().iter().any(|known| known.eq_ignore_ascii_case(name));
    if !is_known {
        return Err(Problem::new(
            StatusCode::FORBIDDEN,
            format!("{name:?} is no name of this service; start it with --name {name} to allow it"),
        ));
    }
    if let Some(origin) = text(headers, header::ORIGIN) {
        let authority = origin.split_once("://").map(|(_, authority)| authority);
        if authority != Some(host) {
            return Err(Problem::new(
                StatusCode::FORBIDDEN,
                format!("a page of {origin:?} may not use this service; open the service's own page"),
            ));
        }
    }
    Ok(())
}

/// The host that a request names: HTTP/2 has it in the address (`:authority`), HTTP/1.1 in a header. Where both stand,
/// they are the same.
fn host<'a>(uri: &'a Uri, headers: &'a HeaderMap) -> Result<&'a str, Problem> {
    if headers.get_all(header::HOST).iter().count() > 1 {
        return Err(Problem::malformed("there are several Host headers"));
    }
    let of_address = uri.authority().map(Authority::as_str);
    match (of_address, text(headers, header::HOST)) {
        (Some(address), Some(header)) if !address.eq_ignore_ascii_case(header) => {
            Err(Problem::malformed("the address and the Host header name different hosts"))
        }
        (Some(host), _) | (None, Some(host)) => Ok(host),
        (None, None) => Err(Problem::malformed("there is no Host header")),
    }
}

/// The name of a host without its port.
fn host_name(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) && !name.is_empty() => name,
        _ => host,
    }
}
