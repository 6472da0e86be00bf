//! Calls of others when a job has ended.

use super::State;
use super::api::JobRequest;
use super::auth::{hex, hmac};
use super::ledger::LedgerError;
use serde_json::json;
use std::io;
use std::thread::JoinHandle;
use std::time::Duration;
use ureq::tls::TlsConfig;

/// The header of the signature: `sha256=` and HMAC-SHA-256 of the body in hexadecimal digits.
const SIGNATURE: &str = "X-Raystream-Signature";

/// How often the ledger is asked for calls that are due.
const INTERVAL: Duration = Duration::from_millis(500);

/// The longest time of a call.
const PATIENCE: Duration = Duration::from_secs(10);

/// Calls that fail before no more are tried: the pauses double from a second, so the last is after an hour.
const MOST_CALLS: u32 = 12;

/// Starts the thread that calls. It ends with the service.
pub fn start(state: State, tls: TlsConfig) -> io::Result<JoinHandle<()>> {
    std::thread::Builder::new().name("webhooks".into()).spawn(move || {
        let agent = ureq::Agent::config_builder()
            .timeout_global(Some(PATIENCE))
            // Whoever is named gets the call; it leads nowhere else.
            .max_redirects(0)
            .tls_config(tls)
            .build()
            .new_agent();
        while !*state.ending().borrow() {
            if let Err(error) = call_all(&state, &agent) {
                log::warn!("{error}");
            }
            std::thread::sleep(INTERVAL);
        }
    })
}

fn call_all(state: &State, agent: &ureq::Agent) -> Result<(), LedgerError> {
    for (id, attempts) in state.ledger().due_calls()? {
        let job = state.ledger().job(&id)?;
        let hook = job.as_ref().and_then(JobRequest::of).and_then(|request| request.webhook);
        let Some((job, hook)) = job.zip(hook) else {
            state.ledger().called(&id, None)?;
            continue;
        };
        let body = json!({ "id": id, "state": job.state, "error": job.error, "ended_ms": job.ended_ms });
        let body = body.to_string();
        let signature = format!("sha256={}", hex(&hmac(hook.secret.as_bytes(), body.as_bytes())));
        let called = agent
            .post(&hook.url)
            .header("Content-Type", "application/json")
            .header(SIGNATURE, &signature)
            .send(&body);
        let again = match called {
            Ok(answer) if answer.status().is_success() => None,
            _ if attempts + 1 >= MOST_CALLS => {
                log::warn!("job {id}: {} did not answer {MOST_CALLS} calls; no more are tried", hook.url);
                None
            }
            _ => Some(1000 << attempts),
        };
        state.ledger().called(&id, again)?;
    }
    Ok(())
}
