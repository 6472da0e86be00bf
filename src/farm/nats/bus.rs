//! The bus.

use super::super::bus::{Backlog, BusError, Lane, Lease, Offered, WorkBus};
use super::super::desk::{Answer, Ask, Desk, Verdict};
use super::super::live::{LiveAnswer, LiveAnswered, LiveAsk, LiveDesk};
use super::super::unit::Unit;
use super::super::{ANSWERED_TOGETHER, BEATS, PART_BYTES};
use super::connection::{NatsError, NatsOptions, TIMEOUT, warn_of_holes};
use super::messages::{
    MOST_BYTES, Question, Reply, join, kind, live_answer, live_question, read_live_answer,
    read_live_question, read_reply, reply, split, with_bytes,
};
use super::queue::Queue;
use super::subjects::{is_inbox, live, question};
use async_nats::client::{Request, RequestErrorKind};
use async_nats::jetstream;
use async_nats::{Client, Message};
use futures_util::StreamExt;
use std::collections::HashMap;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tokio::runtime::{Handle, Runtime};
use tokio::sync::Semaphore;

/// The longest wait for a coordinator that writes a film to its disk.
const DISK_TIMEOUT: Duration = Duration::from_secs(20);

/// The most bytes of films that have not come whole yet; and how long parts are kept for the others.
const MOST_PARTS_BYTES: usize = 1 << 30;
const PARTS_AGE: Duration = Duration::from_secs(60);

/// A bus over a NATS server.
pub struct NatsBus {
    /// Dropped in the background: it may be dropped by one of its own threads.
    runtime: Option<Runtime>,
    client: Client,
    queue: Queue,
    options: NatsOptions,
    /// Where this process is asked for tiles, if it listens.
    address: String,
}

impl std::fmt::Debug for NatsBus {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("NatsBus").field("url", &self.options.url).finish_non_exhaustive()
    }
}

impl NatsBus {
    /// Connects to a server, now or as soon as there is one. `name` is what the server calls the connection.
    ///
    /// # Errors
    /// [`NatsError`] if it must not or cannot be used.
    pub fn connect(options: NatsOptions, name: &str) -> Result<Self, NatsError> {
        options.check()?;
        let address = options.address()?;
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .max_blocking_threads(2 * ANSWERED_TOGETHER)
            .thread_name("nats")
            .enable_all()
            .build();
        let refused =
            |error: std::io::Error| NatsError::Refused { url: options.url.clone(), error: error.to_string() };
        let runtime = runtime.map_err(refused)?;
        let client = runtime.block_on(options.connect(name))?;
        runtime.spawn(look_for_holes(client.clone()));
        let mut context = runtime.block_on(async { jetstream::new(client.clone()) });
        context.set_timeout(TIMEOUT);
        let queue = Queue::new(context, &options);
        Ok(Self { runtime: Some(runtime), client, queue, options, address })
    }

    fn runtime(&self) -> &Runtime {
        self.runtime.as_ref().expect("it is there until the bus is dropped")
    }

    fn run<T>(&self, work: impl Future<Output = T>) -> T {
        self.runtime().block_on(work)
    }

    /// Deletes a queue, as a careless operator would.
    #[cfg(test)]
    pub(super) fn delete_queue(&self, name: &str) {
        self.run(self.queue.delete(name));
    }

    async fn question(&self, ask: &Ask, part: Option<(u64, u64)>, bytes: &[u8]) -> Result<Reply, BusError> {
        let subject = question(&self.options.prefix, kind(ask));
        let patience = if matches!(ask, Ask::Result(_) | Ask::Files(..)) { DISK_TIMEOUT } else { TIMEOUT };
        let message = join(&Question { ask: ask.clone(), part }, bytes);
        let request = Request::new().payload(message.into()).timeout(Some(patience));
        let silent = || BusError::Silent("the coordinator".into());
        match self.client.send_request(subject, request).await {
            Ok(answer) => read_reply(&answer.payload),
            Err(error) => match error.kind() {
                RequestErrorKind::NoResponders | RequestErrorKind::TimedOut => Err(silent()),
                _ => Err(BusError::Refused(format!("NATS: {error}"))),
            },
        }
    }

    /// Sends the sums of a result, part by part, from where the coordinator asks.
    async fn send(&self, ask: &Ask, sums: &[u8]) -> Result<Answer, BusError> {
        let (mut offset, all) = (0, sums.len());
        // A coordinator that begins anew asks for the first part again, but not for ever.
        for _ in 0..2 * all.div_ceil(PART_BYTES).max(1) + 2 {
            let end = (offset + PART_BYTES).min(all);
            match self.question(ask, Some((offset as u64, all as u64)), &sums[offset..end]).await? {
                Reply::Answer(answer) => return Ok(answer),
                Reply::Next(next) => offset = (next as usize).min(all),
            }
        }
        Err(BusError::Refused("the coordinator asks for the same part again and again".into()))
    }
}

impl Drop for NatsBus {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

impl WorkBus for NatsBus {
    fn offer(&self, lane: Lane, unit: &Unit, round: u32) -> Result<Offered, BusError> {
        self.run(self.queue.offer(lane, unit, round))
    }

    fn backlog(&self) -> Result<Backlog, BusError> {
        self.run(self.queue.backlog())
    }

    fn attend(&self, desk: Arc<dyn Desk>) -> Result<(), BusError> {
        let refused = |error: String| BusError::Refused(format!("NATS: {error}"));
        let (client, subject) = (self.client.clone(), question(&self.options.prefix, "*"));
        self.run(async {
            let asked = client.queue_subscribe(subject, "coordinator".into()).await;
            let mut asked = asked.map_err(|error| refused(error.to_string()))?;
            tokio::spawn(async move {
                let (limit, parts) =
                    (Arc::new(Semaphore::new(ANSWERED_TOGETHER)), Arc::new(Parts::default()));
                while let Some(message) = asked.next().await {
                    let Ok(permit) = Arc::clone(&limit).acquire_owned().await else { return };
                    let (client, desk, parts) = (client.clone(), Arc::clone(&desk), Arc::clone(&parts));
                    tokio::spawn(async move {
                        answer(&client, &message, desk, parts).await;
                        drop(permit);
                    });
                }
            });
            Ok(())
        })?;
        // A server that is not there yet gets its queue when the coordinator first looks.
        if let Err(error) = self.backlog() {
            log::warn!("{error}; the queue is made as soon as the server answers");
        }
        Ok(())
    }

    fn lease(&self, patience: Duration) -> Result<Option<Box<dyn Lease>>, BusError> {
        Ok(self.run(self.queue.lease(patience))?.map(|lease| Box::new(lease) as Box<dyn Lease>))
    }

    fn ask(&self, ask: Ask) -> Result<Answer, BusError> {
        self.run(async {
            if let Ask::Result(finished) = &ask {
                let sums = Arc::clone(&finished.sums);
                return self.send(&ask, &sums).await;
            }
            match self.question(&ask, None, &[]).await? {
                Reply::Answer(answer) => Ok(answer),
                Reply::Next(_) => Err(BusError::Unreadable("it asks for a part of nothing".into())),
            }
        })
    }

    fn lease_time(&self) -> Duration {
        self.options.lease
    }

    fn listen(&self, desk: Arc<dyn LiveDesk>) -> Result<String, BusError> {
        let (client, subject) = (self.client.clone(), live(&self.options.prefix, &self.address));
        self.run(async {
            let asked = client.subscribe(subject).await;
            let mut asked = asked.map_err(|error| BusError::Refused(format!("NATS: {error}")))?;
            tokio::spawn(async move {
                while let Some(message) = asked.next().await {
                    show(&client, &message, &*desk);
                }
            });
            Ok(())
        })?;
        Ok(self.address.clone())
    }

    fn request(&self, address: &str, ask: LiveAsk, patience: Duration, answered: LiveAnswered) {
        let (client, subject) = (self.client.clone(), live(&self.options.prefix, address));
        let silent = BusError::Silent(format!("the worker at {address}"));
        let question = live_question(&ask);
        if question.len() > MOST_BYTES {
            let told = format!("a question of {} bytes is more than a message holds", question.len());
            return answered(Err(BusError::Refused(told)));
        }
        self.runtime().spawn(async move {
            let request = Request::new().payload(question.into()).timeout(Some(patience));
            answered(match client.send_request(subject, request).await {
                Ok(answer) => read_live_answer(&answer.payload),
                Err(_) => Err(silent),
            });
        });
    }
}

const _: () = assert!(PART_BYTES < 1 << 20 && BEATS > 1);

/// Looks at the version of a server as soon as there is one.
async fn look_for_holes(client: Client) {
    loop {
        match client.try_server_info() {
            Some(info) if !info.version.is_empty() => return warn_of_holes(&info.version),
            _ => tokio::time::sleep(TIMEOUT).await,
        }
    }
}

/// Lets a desk answer what a coordinator asks. It is called by a thread of the runtime.
fn show(client: &Client, message: &Message, desk: &dyn LiveDesk) {
    let Some(to) = message.reply.clone().filter(|to| is_inbox(to)) else { return };
    let ask = match read_live_question(&message.payload) {
        Ok(ask) => ask,
        Err(error) => return log::warn!("{error}"),
    };
    let (client, runtime) = (client.clone(), Handle::current());
    let reply = move |answer: LiveAnswer| {
        runtime.spawn(async move {
            if let Err(error) = client.publish(to, live_answer(&answer).into()).await {
                log::debug!("{error}");
            }
        });
    };
    desk.take(ask, Box::new(reply));
}

/// Answers a question.
async fn answer(client: &Client, message: &Message, desk: Arc<dyn Desk>, parts: Arc<Parts>) {
    // An answer to another subject would do there what the one who asks may not.
    let Some(to) = message.reply.clone().filter(|to| is_inbox(to)) else { return };
    let answered = match split::<Question>(&message.payload) {
        Ok((Question { ask, part }, bytes)) => match parts.add(&ask, part, bytes) {
            Ok(bytes) => {
                let ask = with_bytes(ask, bytes);
                let answered = tokio::task::spawn_blocking(move || reply(desk.answer(ask))).await;
                answered.ok()
            }
            Err(reply) => Some(join(&reply, &[])),
        },
        Err(error) => {
            log::warn!("{error}");
            None
        }
    };
    // Who gets no answer asks again.
    if let Some(answer) = answered
        && let Err(error) = client.publish(to, answer.into()).await
    {
        log::debug!("{error}");
    }
}

/// Parts of results that have come, by unit, worker and digest.
#[derive(Default)]
struct Parts(Mutex<HashMap<String, (Vec<u8>, Instant)>>);

impl Parts {
    /// Adds a part. Returns all bytes with the last one, else what to answer.
    fn add(&self, ask: &Ask, part: Option<(u64, u64)>, bytes: &[u8]) -> Result<Vec<u8>, Reply> {
        let (Ask::Result(finished), Some((offset, all))) = (ask, part) else { return Ok(bytes.to_vec()) };
        if offset == 0 && bytes.len() as u64 == all {
            return Ok(bytes.to_vec());
        }
        let key = format!("{} {} {}", finished.unit, finished.worker, finished.digest);
        let mut parts = self.0.lock().expect("no holder panics");
        parts.retain(|_, (_, last)| last.elapsed() < PARTS_AGE);
        let held: usize = parts.values().map(|(bytes, _)| bytes.len()).sum();
        if held.saturating_add(bytes.len()) > MOST_PARTS_BYTES || all > MOST_PARTS_BYTES as u64 {
            return Err(Reply::Answer(Answer::Verdict(Verdict::Later)));
        }
        let (have, last) = parts.entry(key.clone()).or_insert_with(|| (Vec::new(), Instant::now()));
        *last = Instant::now();
        if have.len() as u64 == offset {
            have.extend_from_slice(bytes);
        }
        if (have.len() as u64) < all {
            return Err(Reply::Next(have.len() as u64));
        }
        Ok(parts.remove(&key).map_or(Vec::new(), |(bytes, _)| bytes))
    }
}
