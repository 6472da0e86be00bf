//! The work queue: a stream with a consumer for each lane.

use super::super::bus::{Backlog, BusError, Lane, Lease, Offered};
use super::super::unit::Unit;
use super::super::{LEASED_UNITS, QUEUED_UNITS};
use super::connection::{NatsOptions, TIMEOUT};
use super::subjects::{next, stream};
use async_nats::StatusCode;
use async_nats::client::{Request, RequestErrorKind};
use async_nats::jetstream::consumer::{AckPolicy, PullConsumer, pull};
use async_nats::jetstream::context::{PublishError, PublishErrorKind};
use async_nats::jetstream::message::PublishMessage;
use async_nats::jetstream::stream::{Config, DiscardPolicy, RetentionPolicy, StorageType};
use async_nats::jetstream::{AckKind, Context, Message};
use serde_json::json;
use std::fmt::Display;
use std::sync::Mutex;
use std::time::{Duration, Instant};
use tokio::runtime::Handle;

/// The most bytes of a unit.
const UNIT_BYTES: i32 = 256 << 10;

/// How long the server knows the names of units, so that a repeated offer is known as such.
const DUPLICATES: Duration = Duration::from_secs(120);

/// The queue.
pub(super) struct Queue {
    context: Context,
    name: String,
    prefix: String,
    lease: Duration,
    /// When the stream was created, as far as this process knows.
    created: Mutex<Option<String>>,
}

fn refused(error: impl Display) -> BusError {
    BusError::Refused(format!("NATS: {error}"))
}

impl Queue {
    pub fn new(context: Context, options: &NatsOptions) -> Self {
        Self {
            context,
            name: stream(&options.prefix),
            prefix: options.prefix.clone(),
            lease: options.lease,
            created: Mutex::default(),
        }
    }

    /// Makes stream and consumers, unless they are there.
    async fn ensure(&self) -> Result<String, BusError> {
        let config = Config {
            name: self.name.clone(),
            subjects: vec![format!("{}.work.>", self.prefix)],
            retention: RetentionPolicy::WorkQueue,
            storage: StorageType::File,
            discard: DiscardPolicy::New,
            max_messages: QUEUED_UNITS as i64,
            max_message_size: UNIT_BYTES,
            duplicate_window: DUPLICATES,
            num_replicas: 1,
            ..Config::default()
        };
        let stream = self.context.get_or_create_stream(config).await.map_err(refused)?;
        for lane in Lane::ALL {
            let config = pull::Config {
                durable_name: Some(lane.name().into()),
                filter_subject: format!("{}.work.{}.>", self.prefix, lane.name()),
                ack_policy: AckPolicy::Explicit,
                ack_wait: self.lease,
                // The ledger counts attempts; a message that the server gives up would be lost.
                max_deliver: -1,
                max_ack_pending: LEASED_UNITS as i64,
                ..pull::Config::default()
            };
            stream.create_consumer(config).await.map_err(refused)?;
        }
        Ok(format!("{:?}", stream.cached_info().created))
    }

    #[cfg(test)]
    pub async fn delete(&self, name: &str) {
        self.context.delete_stream(name).await.expect("the queue is there");
    }

    pub async fn offer(&self, lane: Lane, unit: &Unit, round: u32) -> Result<Offered, BusError> {
        let payload = serde_json::to_vec(unit).map_err(refused)?;
        let id = format!("{}.{round}", unit.id);
        let message = PublishMessage::build().message_id(id).payload(payload.into());
        let subject = format!("{}.work.{}.{}", self.prefix, lane.name(), unit.id);
        let acked = match self.context.send_publish(subject, message).await {
            Ok(acked) => acked.await,
            Err(error) => Err(error),
        };
        match acked {
            Ok(ack) if ack.duplicate => Ok(Offered::Duplicate),
            Ok(_) => Ok(Offered::New),
            Err(error) if is_full(&error) => Ok(Offered::Full),
            Err(error) => Err(refused(error)),
        }
    }

    /// What the queue holds. Messages that a server has kept although they were acknowledged (2.9.10 does, after a
    /// crash) do not count.
    pub async fn backlog(&self) -> Result<Backlog, BusError> {
        let created = self.ensure().await?;
        let mut units = 0;
        for lane in Lane::ALL {
            let consumer: PullConsumer =
                self.context.get_consumer_from_stream(lane.name(), &self.name).await.map_err(refused)?;
            let info = consumer.cached_info();
            units += info.num_pending + info.num_ack_pending as u64;
        }
        let mut known = self.created.lock().expect("no holder panics");
        let is_new = known.as_ref().is_some_and(|known| *known != created);
        *known = Some(created);
        Ok(Backlog { units, is_new })
    }

    pub async fn lease(&self, patience: Duration) -> Result<Option<NatsLease>, BusError> {
        for lane in Lane::ALL {
            if let Some(lease) = self.lease_of(lane, patience).await? {
                return Ok(Some(lease));
            }
        }
        Ok(None)
    }

    /// Asks for the next unit of a lane. That is a request without any before it, so that a worker's key needs to be
    /// allowed this alone.
    async fn lease_of(&self, lane: Lane, patience: Duration) -> Result<Option<NatsLease>, BusError> {
        let (wanted, wait) = match lane {
            Lane::Hi => (json!({ "batch": 1, "no_wait": true }), Duration::ZERO),
            Lane::Lo => (json!({ "batch": 1, "expires": patience.as_nanos() as u64 }), patience),
        };
        let client = self.context.client();
        // An inbox of its own: a unit comes with its own subject, by which the client does not know the request again.
        let inbox = client.new_inbox();
        let request =
            Request::new().payload(wanted.to_string().into()).inbox(inbox).timeout(Some(wait + TIMEOUT));
        let asked = client.send_request(next(&self.prefix, lane), request).await;
        let message = match asked {
            Ok(message) => Message { message, context: self.context.clone() },
            Err(error) if error.kind() == RequestErrorKind::TimedOut => {
                return Err(BusError::Silent("NATS".into()));
            }
            Err(error) => return Err(refused(error)),
        };
        match message.status {
            None => {}
            Some(StatusCode::NOT_FOUND | StatusCode::TIMEOUT) => return Ok(None),
            Some(status) => {
                let told = message.description.clone().unwrap_or_default();
                return Err(refused(format!("{status} {told}")));
            }
        }
        let unit = match serde_json::from_slice(&message.payload) {
            Ok(unit) => unit,
            Err(error) => {
                // The coordinator offers it again, in its own words.
                message.ack_with(AckKind::Term).await.map_err(refused)?;
                return Err(BusError::Unreadable(error.to_string()));
            }
        };
        let deliveries = message.info().map_or(1, |info| info.delivered.max(1) as u64);
        let since = Mutex::new(Instant::now());
        Ok(Some(NatsLease {
            unit,
            deliveries,
            message,
            runtime: Handle::current(),
            lease: self.lease,
            since,
        }))
    }
}

/// Whether an offer was refused because the queue is full.
fn is_full(error: &PublishError) -> bool {
    error.kind() == PublishErrorKind::Other && format!("{error:?}").contains("maximum messages")
}

/// A message of the queue that this process has.
pub(super) struct NatsLease {
    unit: Unit,
    deliveries: u64,
    message: Message,
    runtime: Handle,
    lease: Duration,
    /// When the server last heard that the unit is held.
    since: Mutex<Instant>,
}

impl NatsLease {
    fn acknowledge(&self, kind: AckKind) {
        let acked = async { tokio::time::timeout(TIMEOUT, self.message.double_ack_with(kind)).await };
        match self.runtime.block_on(acked) {
            Ok(Ok(())) => {}
            // Then another worker gets the unit, and the coordinator has it skip it.
            Ok(Err(error)) => log::debug!("unit {}: {error}", self.unit.id),
            Err(_) => log::debug!("unit {}: NATS does not answer", self.unit.id),
        }
    }
}

impl Lease for NatsLease {
    fn unit(&self) -> &Unit {
        &self.unit
    }

    fn deliveries(&self) -> u64 {
        self.deliveries
    }

    fn beat(&self) {
        let beaten = async { tokio::time::timeout(TIMEOUT, self.message.ack_with(AckKind::Progress)).await };
        if matches!(self.runtime.block_on(beaten), Ok(Ok(()))) {
            *self.since.lock().expect("no holder panics") = Instant::now();
        } else {
            log::debug!("unit {}: a beat is lost", self.unit.id);
        }
    }

    fn done(&self) {
        self.acknowledge(AckKind::Ack);
    }

    fn give_back(&self, delay: Duration) {
        // Once the lease is over someone else may have the unit. The server would take it from them: 2.9.10 heeds what
        // is said of any delivery.
        if self.since.lock().expect("no holder panics").elapsed() < self.lease {
            self.acknowledge(AckKind::Nak((!delay.is_zero()).then_some(delay)));
        }
    }
}
