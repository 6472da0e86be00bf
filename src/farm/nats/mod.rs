//! The bus over NATS JetStream: a work queue for units, requests for everything else.
//!
//! Nothing of value lies on the server. Films and scenes travel in requests, from one process's memory into the other's
//! disk; the queue holds names of units, which the ledger knows too. `docs/design/farm.md` names subjects and settings.

mod bus;
mod connection;
mod keys;
mod messages;
mod queue;
pub mod settings;
mod spawn;
mod subjects;
#[cfg(test)]
mod tests;

pub use bus::NatsBus;
pub use connection::{NatsError, NatsOptions};
pub use keys::{Certificates, NatsKey};
pub use spawn::NatsServer;
