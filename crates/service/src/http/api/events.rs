//! Events of jobs, as they happen (server-sent events).

use crate::contract::Problem;
use crate::coordinator::ledger::{Event as Happened, EventsOf};
use crate::http::caller::Caller;
use crate::http::state::State;
use axum::extract::{Path, State as Given};
use axum::http::HeaderMap;
use axum::response::sse::{Event, KeepAlive, Sse};
use futures_util::{Stream, stream};
use std::collections::VecDeque;
use std::convert::Infallible;
use std::time::Duration;

/// Events that are read at a time.
const READ: usize = 256;

/// Connections get a comment at this interval, so that proxies do not end them.
const KEEP_ALIVE: Duration = Duration::from_secs(15);

/// `GET /api/v1/jobs/{id}/events`.
pub async fn of_job(
    Given(state): Given<State>,
    caller: Caller,
    Path(id): Path<String>,
    headers: HeaderMap,
) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>>>, Problem> {
    let (asked, asking) = (id.clone(), caller.clone());
    state.blocking(move |state| asking.job(state, &asked)).await?;
    let after = last_event(&headers)?.unwrap_or(0);
    Ok(stream_of(state, caller, Some(id), after))
}

/// `GET /api/v1/events`: those of all jobs that the caller may see, from now on or after `Last-Event-ID`.
pub async fn of_all(
    Given(state): Given<State>,
    caller: Caller,
    headers: HeaderMap,
) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>>>, Problem> {
    let after = match last_event(&headers)? {
        Some(after) => after,
        None => state.blocking(|state| Ok(state.ledger().last_event()?)).await?,
    };
    Ok(stream_of(state, caller, None, after))
}

fn last_event(headers: &HeaderMap) -> Result<Option<i64>, Problem> {
    let Some(value) = headers.get("last-event-id") else { return Ok(None) };
    let number = value.to_str().ok().and_then(|text| text.trim().parse().ok());
    number.map(Some).ok_or_else(|| Problem::malformed("Last-Event-ID is the number of an event"))
}

/// What a stream of events remembers.
struct Listener {
    state: State,
    caller: Caller,
    job: Option<String>,
    after: i64,
    waiting: VecDeque<Happened>,
}

fn stream_of(
    state: State,
    caller: Caller,
    job: Option<String>,
    after: i64,
) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    let listener = Listener { state, caller, job, after, waiting: VecDeque::new() };
    let events = stream::unfold(listener, |mut listener| async move {
        let event = listener.next().await?;
        let shown = Event::default().id(event.seq.to_string()).event(event.kind.clone());
        let data =
            format!("{{\"job\":\"{}\",\"time_ms\":{},\"data\":{}}}", event.job, event.time_ms, event.data);
        Some((Ok(shown.data(data)), listener))
    });
    Sse::new(events).keep_alive(KeepAlive::new().interval(KEEP_ALIVE))
}

impl Listener {
    /// The next event; `None` if the service or the caller's token ends, or the ledger fails. Clients connect again
    /// then.
    async fn next(&mut self) -> Option<Happened> {
        let mut committed = self.state.ledger().committed();
        let mut ending = self.state.ending();
        loop {
            if let Some(event) = self.waiting.pop_front() {
                self.after = event.seq;
                return Some(event);
            }
            committed.mark_unchanged();
            let (caller, job, after) = (self.caller.clone(), self.job.clone(), self.after);
            let read = self.state.blocking(move |state| {
                let of = match (&job, caller.scope()) {
                    (Some(job), _) => EventsOf::Job(job),
                    (None, Some(tenant)) => EventsOf::Tenant(tenant),
                    (None, None) => EventsOf::All,
                };
                let events = state.ledger().events(of, after, READ)?;
                Ok(caller.holds(state)?.then_some(events))
            });
            self.waiting = read.await.ok()??.into();
            if self.waiting.is_empty() {
                let changed = committed.changed();
                let end = ending.wait_for(|ending| *ending);
                match futures_util::future::select(Box::pin(changed), Box::pin(end)).await {
                    futures_util::future::Either::Left((changed, _)) => changed.ok()?,
                    futures_util::future::Either::Right(_) => return None,
                }
            }
        }
    }
}
