//! Calls of others when a job has ended.

use super::reach::Reach;
use super::state::State;
use crate::contract::hex;
use crate::coordinator::hmac;
use crate::coordinator::ledger::{DueCall, LedgerError, Outcome, now_ms};
use serde_json::json;
use std::collections::HashMap;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;
use ureq::Agent;
use ureq::tls::TlsConfig;
use ureq::unversioned::transport::DefaultConnector;

/// The headers of a call: the delivery's name, which is the same each time that it is tried, when it was made (seconds
/// since 1970), and `sha256=` and HMAC-SHA-256 of name, time and body with points between them in hexadecimal digits.
const DELIVERY: &str = "X-Raystream-Delivery";
const TIMESTAMP: &str = "X-Raystream-Timestamp";
const SIGNATURE: &str = "X-Raystream-Signature";
/// The number of the call among those of its delivery, from 1. It is not signed.
const ATTEMPT: &str = "X-Raystream-Attempt";

/// How often the ledger is asked for calls that are due.
const INTERVAL: Duration = Duration::from_millis(500);

/// The longest time of a call.
const PATIENCE: Duration = Duration::from_secs(10);

/// Calls that are made at the same time, and those of one tenant, so that receivers that sleep delay no other's.
const TOGETHER: usize = 64;
const TOGETHER_OF_TENANT: usize = 16;

/// Calls that fail before no more are tried: the pauses double from a second, so the last is after half an hour.
const MOST_CALLS: u32 = 12;

/// How long a delivery rests if the ledger cannot take down what became of its call: it will be made again.
const NAP: Duration = Duration::from_secs(5);

/// The most characters of an error.
const ERROR_LENGTH: usize = 200;

/// What calls share.
struct Calls {
    state: State,
    agent: Agent,
    /// Deliveries whose calls are being made, and their tenants.
    under_way: Mutex<HashMap<String, String>>,
}

/// Starts the thread that calls. It ends with the service.
pub fn start(state: State, tls: TlsConfig, reach: Reach) -> io::Result<JoinHandle<()>> {
    let config = Agent::config_builder()
        .timeout_global(Some(PATIENCE))
        // Whoever is named gets the call; it leads nowhere else.
        .max_redirects(0)
        // A proxy would look up names that are to be checked here.
        .proxy(None)
        // A connection that is kept is to an address that was checked, but each call says anew where a name leads.
        .max_idle_connections(0)
        .http_status_as_error(false)
        .tls_config(tls)
        .build();
    let agent = Agent::with_parts(config, DefaultConnector::default(), reach);
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
    fn under_way(&self) -> MutexGuard<'_, HashMap<String, String>> {
        self.under_way.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// True if a call may be made now. It is under way then.
    fn takes(&self, due: &DueCall) -> bool {
        let mut under_way = self.under_way();
        let of_tenant = under_way.values().filter(|tenant| **tenant == due.tenant).count();
        let takes =
            under_way.len() < TOGETHER && of_tenant < TOGETHER_OF_TENANT && !under_way.contains_key(&due.id);
        if takes {
            under_way.insert(due.id.clone(), due.tenant.clone());
        }
        takes
    }

    /// Begins the calls that are due.
    fn begin(self: &Arc<Self>) -> Result<(), LedgerError> {
        // Those under way are due as well.
        for due in self.state.ledger().due_calls(2 * TOGETHER_OF_TENANT)? {
            if !self.takes(&due) {
                continue;
            }
            let (own, id) = (Arc::clone(self), due.id.clone());
            let called = std::thread::Builder::new().name("webhook".into()).spawn(move || {
                if let Err(error) = own.call(&due) {
                    log::warn!("job {}: the call of {} will be made again: {error}", due.job, due.hook.url);
                    std::thread::sleep(NAP);
                }
                own.under_way().remove(&due.id);
            });
            if let Err(error) = called {
                log::warn!("delivery {id}: the system refuses a thread: {error}");
                self.under_way().remove(&id);
            }
        }
        Ok(())
    }

    fn call(&self, due: &DueCall) -> Result<(), LedgerError> {
        let DueCall { id, job, hook, attempts, .. } = due;
        let ledger = self.state.ledger();
        // It may have been deleted meanwhile, with its deliveries.
        let Some(job) = ledger.job(job)? else { return Ok(()) };
        let body = json!({ "id": job.id, "state": job.state, "error": job.error, "ended_ms": job.ended_ms });
        let body = body.to_string();
        let began_ms = now_ms();
        let time = began_ms / 1000;
        let signed = format!("{id}.{time}.{body}");
        let signature = format!("sha256={}", hex(&hmac(hook.secret.as_bytes(), signed.as_bytes())));
        let called = self
            .agent
            .post(&hook.url)
            .header("Content-Type", "application/json")
            .header(DELIVERY, id)
            .header(TIMESTAMP, time.to_string())
            .header(SIGNATURE, &signature)
            .header(ATTEMPT, (attempts + 1).to_string())
            .send(&body);
        let (status, error) = match called {
            Ok(answer) if answer.status().is_success() => (Some(answer.status().as_u16()), None),
            Ok(answer) => {
                (Some(answer.status().as_u16()), Some(format!("the answer was {}", answer.status())))
            }
            Err(error) => (None, Some(reason(&error))),
        };
        self.state.traces().called(&job, due, began_ms, error.is_some());
        let subject = format!("delivery {id}, {}", job.subject());
        match &error {
            None => log::info!("{subject}: delivered by call {}", attempts + 1),
            Some(error) => log::info!("{subject}: call {} has failed: {error}", attempts + 1),
        }
        let gives_up = error.is_some() && attempts + 1 >= MOST_CALLS;
        if gives_up {
            log::warn!("{subject}: {MOST_CALLS} calls of {} have failed; no more are tried", hook.url);
        }
        let result = if error.is_some() { "failed" } else { "delivered" };
        metrics::counter!("raystream_webhook_calls_total", "result" => result).increment(1);
        let again_in_ms = (error.is_some() && !gives_up).then(|| 1000 << attempts);
        ledger.called(id, Outcome { status, error, again_in_ms })
    }
}

/// The reason why a call has failed, as its list shows it.
fn reason(error: &ureq::Error) -> String {
    let text = match error {
        ureq::Error::Timeout(_) => format!("no answer within {} s", PATIENCE.as_secs()),
        ureq::Error::HostNotFound => "the host has no address".into(),
        ureq::Error::Other(other) => other.to_string(),
        other => other.to_string(),
    };
    text.chars().take(ERROR_LENGTH).collect()
}
