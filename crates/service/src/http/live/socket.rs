//! A live view on a WebSocket: frames as binary messages, requests and replies as JSON.

use crate::http::caller::Caller;
use crate::http::state::State;
use crate::live::{CountedView, LiveViews, Reply, Request, ViewScene};
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Notify, watch};
use tokio::time::Instant;

/// Frames that the client has been sent and has not shown yet, at most.
const CREDITS: usize = 2;

/// The longest message of a client in bytes: a shader and what is around it.
const MOST_BYTES: usize = raystream::program::MAX_SOURCE_BYTES + 4096;

/// The code with which a connection is closed that gets no view.
const REFUSED: u16 = 4001;

/// How often a client is pinged, and its token looked at again.
const CHECKED: Duration = Duration::from_secs(10);

/// The time after which a client that does not even answer pings is given up.
const GIVE_UP_AFTER: Duration = Duration::from_secs(50);

/// The limits of an upgrade that are to be set before it is accepted.
pub fn limited(upgrade: WebSocketUpgrade) -> WebSocketUpgrade {
    upgrade.max_message_size(MOST_BYTES).max_frame_size(MOST_BYTES)
}

/// Runs a view of a scene until its client leaves or the service ends. Without a scene the client is told why.
pub async fn run(
    mut socket: WebSocket,
    views: Arc<LiveViews>,
    view_scene: Result<ViewScene, String>,
    (state, caller): (State, Caller),
) {
    let mut ending = state.ending();
    let mut checks = tokio::time::interval_at(Instant::now() + CHECKED, CHECKED);
    let notify = Arc::new(Notify::new());
    let view = match open(&views, view_scene, &notify).await {
        Ok(view) => view,
        Err(reason) => return refuse(socket, reason).await,
    };
    let mut unshown: Vec<u32> = Vec::with_capacity(CREDITS);
    let mut heard = Instant::now();
    loop {
        while let Some(reply) = view.take_reply() {
            if send_reply(&mut socket, &reply).await.is_err() {
                return close(view);
            }
        }
        while let Some(file) = view.take_file() {
            if socket.send(Message::Binary(file.to_bytes().into())).await.is_err() {
                return close(view);
            }
        }
        if unshown.len() < CREDITS
            && let Some(frame) = view.take_frame()
        {
            unshown.push(frame.sequence);
            if socket.send(Message::Binary(frame.to_bytes().into())).await.is_err() {
                return close(view);
            }
        }
        tokio::select! {
            () = notify.notified() => {}
            () = ended(&mut ending) => {
                // The client connects again when the service is back.
                socket.send(Message::Close(None)).await.ok();
                return close(view);
            }
            message = socket.recv() => {
                heard = Instant::now();
                let answered = match message {
                    Some(Ok(Message::Text(text))) => answer(&text, &views, &view, &mut unshown),
                    Some(Ok(Message::Close(_)) | Err(_)) | None => return close(view),
                    Some(Ok(_)) => Ok(()),
                };
                if let Err(reason) = answered
                    && send_reply(&mut socket, &Reply::Refused { reason }).await.is_err()
                {
                    return close(view);
                }
            }
            _ = checks.tick() => {
                let asking = caller.clone();
                if !state.blocking(move |state| asking.holds(state)).await.unwrap_or(true) {
                    close(view);
                    return refuse(socket, "the token has ended; log in again".into()).await;
                }
                let is_silent = heard.elapsed() > GIVE_UP_AFTER;
                if is_silent || socket.send(Message::Ping(Default::default())).await.is_err() {
                    return close(view);
                }
            }
        }
    }
}

/// Starts a view, which wakes its connection by `notify`.
async fn open(
    views: &Arc<LiveViews>,
    view_scene: Result<ViewScene, String>,
    notify: &Arc<Notify>,
) -> Result<CountedView, String> {
    let (view_scene, opening, waking) = (view_scene?, Arc::clone(views), Arc::clone(notify));
    // Making a table and starting threads may take some hundredths of a second.
    let opened =
        tokio::task::spawn_blocking(move || opening.open(view_scene, move || waking.notify_one())).await;
    match opened {
        Ok(view) => view.map_err(|error| error.to_string()),
        Err(_) => Err("the view could not be started; try again".into()),
    }
}

/// Waits until the service is to end.
async fn ended(ending: &mut watch::Receiver<bool>) {
    // The sender lives as long as the service.
    ending.wait_for(|ending| *ending).await.ok();
}

/// Passes a request on. An error is a reason to refuse it.
fn answer(
    text: &str,
    views: &LiveViews,
    view: &crate::live::LiveView,
    unshown: &mut Vec<u32>,
) -> Result<(), String> {
    let request: Request =
        serde_json::from_str(text).map_err(|error| format!("a message is not understood: {error}"))?;
    views.limits().check(&request)?;
    match request {
        Request::Ack { sequence } => unshown.retain(|&frame| frame > sequence),
        request => view.ask(request),
    }
    Ok(())
}

async fn send_reply(socket: &mut WebSocket, reply: &Reply) -> Result<(), axum::Error> {
    let text = serde_json::to_string(reply).map_err(axum::Error::new)?;
    socket.send(Message::Text(text.into())).await
}

async fn refuse(mut socket: WebSocket, reason: String) {
    // The client may have left already.
    send_reply(&mut socket, &Reply::Refused { reason }).await.ok();
    // A client that knows the code does not ask for the same again.
    let frame = CloseFrame { code: REFUSED, reason: "refused".into() };
    socket.send(Message::Close(Some(frame))).await.ok();
}

/// Ends a view on a thread that may wait for it.
fn close(view: CountedView) {
    tokio::task::spawn_blocking(move || drop(view));
}
