//! The bus.

use super::connection::{NatsError, NatsOptions, TIMEOUT, warn_of_holes};
use super::keys::Identity;
use super::messages::{
    MOST_BYTES, Question, Reply, join, kind, live_answer, live_question, read_live_answer,
    read_live_question, read_reply, reply, split, with_bytes,
};
use super::parts::Parts;
use super::subjects::{asked, bell, is_inbox, live, old_question, question};
use super::turns::Turns;
use crate::bus::bell::Bell;
use crate::bus::{BusError, LiveAnswered, WorkBus};
use crate::contract::{
    ANSWERED_TOGETHER, Answer, Ask, Coordinator, JoinReply, LiveAnswer, LiveAsk, PART_BYTES, TileServer,
};
use async_nats::client::{Request, RequestErrorKind};
use async_nats::{Client, Message};
use futures_util::StreamExt;
use std::sync::Arc;
use std::time::Duration;
use tokio::runtime::{Handle, Runtime};

/// The longest wait for a coordinator that writes a film to its disk.
const DISK_TIMEOUT: Duration = Duration::from_secs(20);

/// A bus over a NATS server.
pub struct NatsBus {
    /// Dropped in the background: it may be dropped by one of its own threads.
    runtime: Option<Runtime>,
    client: Client,
    options: NatsOptions,
    /// Who this process is.
    identity: Identity,
    bell: Arc<Bell>,
}

impl std::fmt::Debug for NatsBus {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("NatsBus").field("url", &self.options.url).finish_non_exhaustive()
    }
}

impl NatsBus {
    /// Connects to a server, now or as soon as there is one. `name` is what the server calls the connection, and what
    /// this process is known by where it has no key.
    ///
    /// # Errors
    /// [`NatsError`] if it must not or cannot be used.
    pub fn connect(options: NatsOptions, name: &str) -> Result<Self, NatsError> {
        options.check()?;
        let identity = Identity::of(options.nkey.as_deref(), name)?;
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .max_blocking_threads(2 * ANSWERED_TOGETHER)
            .thread_name("nats")
            .enable_all()
            .build();
        let refused =
            |error: std::io::Error| NatsError::Refused { url: options.url.clone(), error: error.to_string() };
        let runtime = runtime.map_err(refused)?;
        let client = runtime.block_on(options.connect(name, &identity))?;
        runtime.spawn(look_for_holes(client.clone()));
        Ok(Self { runtime: Some(runtime), client, options, identity, bell: Arc::default() })
    }

    /// The key by which the other side knows this process.
    #[cfg(test)]
    pub(super) fn key(&self) -> &str {
        &self.identity.name
    }

    fn runtime(&self) -> &Runtime {
        self.runtime.as_ref().expect("it is there until the bus is dropped")
    }

    fn run<T>(&self, work: impl Future<Output = T>) -> T {
        self.runtime().block_on(work)
    }

    async fn question(&self, ask: &Ask, part: Option<(u64, u64)>, bytes: &[u8]) -> Result<Reply, BusError> {
        let subject = question(&self.options.prefix, kind(ask), &self.identity.name);
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
    fn attend(&self, coordinator: Arc<dyn Coordinator>) -> Result<(), BusError> {
        let refused = |error: String| BusError::Refused(format!("NATS: {error}"));
        let (client, prefix) = (self.client.clone(), self.options.prefix.clone());
        self.run(async {
            let group = || "coordinator".to_owned();
            let questions = client.queue_subscribe(question(&prefix, "*", "*"), group()).await;
            let mut questions = questions.map_err(|error| refused(error.to_string()))?;
            let old = client.queue_subscribe(old_question(&prefix), group()).await;
            let mut old = old.map_err(|error| refused(error.to_string()))?;
            let of_old = client.clone();
            tokio::spawn(async move {
                while let Some(message) = old.next().await {
                    refuse_old(&of_old, &message).await;
                }
            });
            tokio::spawn(async move {
                let (parts, turns) = (Arc::new(Parts::default()), Arc::new(Turns::default()));
                while let Some(message) = questions.next().await {
                    // Who gets no answer asks again.
                    let Some((_, key)) = asked(&prefix, &message.subject) else { continue };
                    let Some(queued) = turns.queue(key) else { continue };
                    let (client, coordinator, parts) =
                        (client.clone(), Arc::clone(&coordinator), Arc::clone(&parts));
                    tokio::spawn(async move {
                        let turn = queued.turn().await;
                        answer(&client, &message, turn.key(), coordinator, parts).await;
                    });
                }
            });
            Ok(())
        })
    }

    fn ring(&self) {
        let (client, subject) = (self.client.clone(), bell(&self.options.prefix));
        self.runtime().spawn(async move {
            if let Err(error) = client.publish(subject, "".into()).await {
                log::debug!("{error}");
            }
        });
    }

    fn bell(&self) -> &Bell {
        &self.bell
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

    fn listen(&self, tiles: Arc<dyn TileServer>) -> Result<(), BusError> {
        let (client, own) = (self.client.clone(), Arc::clone(&self.bell));
        let prefix = &self.options.prefix;
        self.run(async {
            let refused = |error: async_nats::SubscribeError| BusError::Refused(format!("NATS: {error}"));
            let mut asked = client.subscribe(live(prefix, &self.identity.name)).await.map_err(refused)?;
            let mut rung = client.subscribe(bell(prefix)).await.map_err(refused)?;
            tokio::spawn(async move {
                while let Some(message) = asked.next().await {
                    show(&client, &message, &*tiles);
                }
            });
            tokio::spawn(async move {
                while rung.next().await.is_some() {
                    own.ring();
                }
            });
            Ok(())
        })
    }

    fn request(&self, key: &str, ask: LiveAsk, patience: Duration, answered: LiveAnswered) {
        let (client, subject) = (self.client.clone(), live(&self.options.prefix, key));
        let silent = BusError::Silent(format!("the worker {key}"));
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

const _: () = assert!(PART_BYTES < MOST_BYTES);

/// Looks at the version of a server as soon as there is one.
async fn look_for_holes(client: Client) {
    loop {
        match client.try_server_info() {
            Some(info) if !info.version.is_empty() => return warn_of_holes(&info.version),
            _ => tokio::time::sleep(TIMEOUT).await,
        }
    }
}

/// Lets a server of tiles answer a coordinator. It is called by a thread of the runtime.
fn show(client: &Client, message: &Message, tiles: &dyn TileServer) {
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
    tiles.take(ask, Box::new(reply));
}

/// Tells a worker of an older raystream that it is one.
async fn refuse_old(client: &Client, message: &Message) {
    let Some(to) = message.reply.clone().filter(|to| is_inbox(to)) else { return };
    let told = "the coordinator's raystream is newer than this one, and reads none of its messages; install the same";
    let refused = reply(Answer::Joined(JoinReply::Refused(told.into())));
    if let Err(error) = client.publish(to, refused.into()).await {
        log::debug!("{error}");
    }
}

/// Answers a question of the worker of a key.
async fn answer(
    client: &Client,
    message: &Message,
    key: &str,
    coordinator: Arc<dyn Coordinator>,
    parts: Arc<Parts>,
) {
    // An answer to another subject would do there what the one who asks may not.
    let Some(to) = message.reply.clone().filter(|to| is_inbox(to)) else { return };
    let answered = match split::<Question>(&message.payload) {
        Ok((Question { ask, part }, bytes)) => {
            let own = key.to_owned();
            let bytes = bytes.to_vec();
            let work = move || match parts.add(&*coordinator, &own, &ask, part, &bytes) {
                Ok(bytes) => reply(coordinator.answer(&own, with_bytes(ask, bytes))),
                Err(reply) => join(&reply, &[]),
            };
            tokio::task::spawn_blocking(work).await.ok()
        }
        Err(error) => {
            log::debug!("worker {key}: {error}");
            metrics::counter!("raystream_refused_messages_total", "reason" => "unreadable").increment(1);
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
