//! The bus over a NATS server: requests and their answers.
//!
//! Nothing lies on the server. Units, films and scenes travel in requests, from one process's memory into the other's
//! disk. The server lets a worker's key ask under its own name alone. `docs/design/farm.md` has subjects and settings.

mod bus;
mod connection;
mod keys;
mod messages;
mod parts;
pub mod settings;
mod spawn;
mod subjects;
#[cfg(test)]
mod tests;
mod turns;

pub use bus::NatsBus;
pub use connection::{NatsError, NatsOptions};
pub use keys::{Certificates, NatsKey};
pub use spawn::NatsServer;
