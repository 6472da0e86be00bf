//! Calls of others when a job has ended.

use super::state::State;
use crate::contract::hex;
use crate::coordinator::ledger::LedgerError;
use crate::coordinator::{JobRequest, hmac};
use serde_json::json;
use std::collections::HashSet;
use std::io;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use ureq::Agent;
use ureq::tls::TlsConfig;

/// The headers of a call: its number, which is the same each time that it is tried, when it was made (seconds since
/// 1970), and `sha256=` and HMAC-SHA-256 of number, time and body with points between them in hexadecimal digits.
const DELIVERY: &str = "X-Raystream-Delivery";
const TIMESTAMP: &str = "X-Raystream-Timestamp";
const SIGNATURE: &str = "X-Raystream-Signature";

/// How often the ledger is asked for calls that are due.
const INTERVAL: Duration = Duration::from_millis(500);

/// The longest time of a call.
const PATIENCE: Duration = Duration::from_secs(10);

/// Calls that are made at the same time, so that a receiver that sleeps delays no other.
const TOGETHER: usize = 16;

/// Calls that fail before no more are tried: the pauses double from a second, so the last is after an hour.
const MOST_CALLS: u32 = 12;

/// What calls share.
struct Calls {
    state: State,
    agent: Agent,
    /// Jobs whose calls are being made.
    under_way: Mutex<HashSet<String>>,
}

/// Starts the thread that calls. It ends with the service.
pub fn start(state: State, tls: TlsConfig) -> io::Result<JoinHandle<()>> {
    let agent = Agent::config_builder()
        .timeout_global(Some(PATIENCE))
        // Whoever is named gets the call; it leads nowhere else.
        .max_redirects(0)
        .tls_config(tls)
        .build()
        .new_agent();
    let calls = Arc::new(Calls { state, agent, under_way: Mutex::default() });
    std::thread::Builder::new().name("webhooks".into()).spawn(move || {
        while !*calls.state.ending().borrow() {
            if let Err(error) = calls.begin() {
                log::warn!("{error}");
            }
            std::thread::sleep(INTERVAL);
        }
    })
}

impl Calls {
    /// Begins the calls that are due.
    fn begin(self: &Arc<Self>) -> Result<(), LedgerError> {
        for (id, attempts) in self.state.ledger().due_calls()? {
            let mut under_way = self.under_way.lock().unwrap_or_else(PoisonError::into_inner);
            if under_way.len() >= TOGETHER || !under_way.insert(id.clone()) {
                continue;
            }
            drop(under_way);
            let (own, job) = (Arc::clone(self), id.clone());
            let called = std::thread::Builder::new().name("webhook".into()).spawn(move || {
                if let Err(error) = own.call(&job, attempts) {
                    log::warn!("job {job}: {error}");
                }
                own.under_way.lock().unwrap_or_else(PoisonError::into_inner).remove(&job);
            });
            if let Err(error) = called {
                log::warn!("job {id}: the system refuses a thread: {error}");
                self.under_way.lock().unwrap_or_else(PoisonError::into_inner).remove(&id);
            }
        }
        Ok(())
    }

    fn call(&self, id: &str, attempts: u32) -> Result<(), LedgerError> {
        let ledger = self.state.ledger();
        let job = ledger.job(id)?;
        let hook = job.as_ref().and_then(JobRequest::of).and_then(|request| request.webhook);
        let Some((job, hook)) = job.zip(hook) else { return ledger.called(id, None) };
        let body = json!({ "id": id, "state": job.state, "error": job.error, "ended_ms": job.ended_ms });
        let body = body.to_string();
        let time = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        let signed = format!("{id}.{time}.{body}");
        let signature = format!("sha256={}", hex(&hmac(hook.secret.as_bytes(), signed.as_bytes())));
        let called = self
            .agent
            .post(&hook.url)
            .header("Content-Type", "application/json")
            .header(DELIVERY, id)
            .header(TIMESTAMP, time.to_string())
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
        ledger.called(id, again)
    }
}
